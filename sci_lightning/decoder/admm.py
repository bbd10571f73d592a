"""ADMM: the alternating direction method of multipliers with any denoiser as the prior."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.configuration.bounds import Iterations
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import Denoiser
from sci_lightning.decoder.denoiser.motion_filter import MotionFilter
from sci_lightning.decoder.iterative import Iterative, reused
from sci_lightning.errors import BadInput


class ADMM(Iterative):
    """The alternating direction method of multipliers with any denoiser as the prior, for any T, H and W.

    Every iteration computes x = data step of theta + b, theta = denoise(x - b), b = b - (x - theta). The estimate is
    theta.

    Args:
        denoiser, strengths, iterations, tolerance, start, motion: see :class:`Iterative`.
        gamma: weight with which x is kept near theta + b against the measurement (0.01 is usual); with more noise in
            the measurement a larger one is right.

    Raises:
        BadInput: as for :class:`Iterative`, or gamma is not positive.

    Source: Boyd et al., "Distributed optimization and statistical learning via the alternating direction method of
    multipliers", 2011; for video SCI as in Liu, Yuan, Suo, Brady and Dai, "Rank minimization for snapshot compressive
    imaging", TPAMI 2019.
    """

    def __init__(
        self,
        denoiser: Denoiser,
        strengths: Sequence[float],
        iterations: Sequence[Iterations],
        tolerance: float | None = None,
        start: Decoder | None = None,
        motion: MotionFilter | None = None,
        gamma: float = 0.01,
    ) -> None:
        super().__init__(denoiser, strengths, iterations, tolerance, start, motion)
        if not gamma > 0:
            raise BadInput(f"decoder.gamma={gamma}: must be positive")
        self.gamma = gamma

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        weight = operator.sum_of_squares() + self.gamma
        theta = self.first_estimate(measurement, mask)
        b = torch.zeros_like(theta)
        for iteration, strength in self.schedule():
            x = theta + b
            x = operator.data_step(x, measurement, weight, out=reused(x))
            theta = self.denoised(x - b, strength)
            if self.reached(measurement - operator(theta), iteration):
                break
            b = torch.sub(b, torch.sub(x, theta, out=reused(x)), out=reused(b))
        return theta
