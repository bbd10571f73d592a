"""The base class of metrics that are computed frame by frame and averaged over all frames."""

from __future__ import annotations

from typing import Any

import torch
from torchmetrics import Metric

from sci_lightning.errors import BadInput
from sci_lightning.imaging.full_precision import full_precision


class FrameMetric(Metric):
    """The mean over frames of :meth:`score`; sums are kept in float64 and added up over processes."""

    is_differentiable = True
    higher_is_better = True
    full_state_update = False
    smallest = 1
    """Smallest height and width of frames, in pixels."""
    convention = ""
    """The convention that has to be stated wherever the values are printed, in words; empty if there is none."""
    total: torch.Tensor
    frames: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.add_state("total", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("frames", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Return one value per frame, ``(...)``, of two videos ``(..., H, W)``."""
        raise NotImplementedError

    def update(self, estimate: torch.Tensor, truth: torch.Tensor) -> None:
        """Add the frames of two ``(..., H, W)`` videos, nominally in [0, 1].

        Raises:
            BadInput: the two videos differ in shape.
        """
        if estimate.shape != truth.shape:
            raise BadInput(f"estimate is {tuple(estimate.shape)} and truth {tuple(truth.shape)}: must be of one shape")
        with full_precision():
            scores = self.score(estimate, truth)
        self.total += scores.sum()
        self.frames += scores.numel()

    def compute(self) -> torch.Tensor:
        return self.total / self.frames

    def plot(self, val: Any = None, ax: Any = None) -> Any:
        """Return figure and axes with the mean so far, or with ``val``, one or more values that calls returned."""
        return self._plot(val, ax)
