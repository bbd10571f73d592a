"""What decoders that iterate without training have in common: the schedule, and when to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, repeat
from typing import NamedTuple

import torch

from sci_lightning.configuration.bounds import MOST_ITERATIONS, Iterations, Positive
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import Denoiser
from sci_lightning.decoder.motion_filter import MotionFilter
from sci_lightning.errors import BadInput


class Iteration(NamedTuple):
    """Where a decoder is."""

    number: int
    """From 1 .."""
    of: int
    """.. to this."""
    residual: float
    """Root mean square of y - sum of M x, of the worst snapshot."""

    def __str__(self) -> str:
        return f"iteration {self.number} of {self.of}, residual {self.residual:.4f}"


class Iterative(Decoder):
    """Data step and denoiser in turns. Any T, H and W.

    The data step divides by the sum of M squared, which is right for gray masks as well; where no slot opens, the
    denoiser alone decides.

    Args:
        denoiser: the prior.
        strengths: the denoiser's, one after another ..
        iterations: .. each for so many iterations.
        tolerance: stop as soon as the root mean square of y - sum of M x is below it in every snapshot, in units of the
            measurement: the noise's standard deviation is a good choice. None: iterate to the end.
        start: another decoder, whose estimate to start from. None: from the mean frame in every slot.
        motion: what follows the denoiser in every iteration; for those that look at every frame by itself. None: no
            more than the denoiser.

    Raises:
        BadInput: a setting that is not positive, or not one number of iterations for each strength; in a call, a
            residual that is no longer finite.
    """

    watch: Callable[[Iteration], object] | None = None
    """Told after every iteration, by one who wants to show it."""

    def __init__(
        self,
        denoiser: Denoiser,
        strengths: Sequence[Positive],
        iterations: Sequence[Iterations],
        tolerance: Positive | None = None,
        start: Decoder | None = None,
        motion: MotionFilter | None = None,
    ) -> None:
        super().__init__()
        if len(strengths) != len(iterations) or not len(strengths):
            raise BadInput(
                f"decoder.strengths={list(strengths)} and decoder.iterations={list(iterations)}: give as many numbers "
                "of iterations as strengths"
            )
        if not all(strength > 0 for strength in strengths):
            raise BadInput(f"decoder.strengths={list(strengths)}: must be positive")
        if not all(number > 0 for number in iterations):
            raise BadInput(f"decoder.iterations={list(iterations)}: must be at least 1 each")
        if sum(iterations) > MOST_ITERATIONS:
            raise BadInput(f"decoder.iterations: {sum(iterations)} in all; expected at most {MOST_ITERATIONS}")
        if tolerance is not None and not tolerance > 0:
            raise BadInput(f"decoder.tolerance={tolerance}: must be positive, or null to iterate to the end")
        if not isinstance(motion, MotionFilter | None):
            raise BadInput(f"decoder.motion={motion}: give null, or override its settings: decoder.motion.reach=4")
        self.denoiser = denoiser
        names = tuple((rf"denoiser\.{ours}", theirs) for ours, theirs in denoiser.published_names)
        self.published_names = names  # type: ignore[misc]  # those of a class elsewhere; here of what it holds
        self.plan = tuple(zip(strengths, iterations, strict=True))
        """Strengths, and for how many iterations."""
        self.tolerance = tolerance
        self.start = start
        self.motion = motion

    def first_estimate(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """``(N, T, H, W)``, to start from."""
        return self.operator(mask).mean_video(measurement) if self.start is None else self.start(measurement, mask)

    def schedule(self) -> Iterator[tuple[int, float]]:
        """Number from 0, and strength, of every iteration; denoiser and motion start afresh."""
        self.denoiser.reset()
        if self.motion is not None:
            self.motion.reset()
        return enumerate(chain.from_iterable(repeat(strength, number) for strength, number in self.plan))

    @property
    def iterations(self) -> int:
        """All of them together."""
        return sum(number for _, number in self.plan)

    def denoised(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """``(N, T, H, W)``, with less noise."""
        video = self.denoiser(video, strength)
        return video if self.motion is None else self.motion(video)

    def reached(self, residual: torch.Tensor, iteration: int) -> bool:
        """Whether to stop after ``iteration`` (from 0), whose y - sum of M x is ``residual``, ``(N, H, W)``.

        Raises:
            BadInput: it is not finite.
        """
        if residual.is_meta:  # no values: the operations are being counted
            return False
        rms = float(residual.detach().square().mean((-2, -1)).sqrt().max())
        if not rms < float("inf"):  # also false for NaN
            raise BadInput(
                f"{type(self).__name__} iteration {iteration + 1} of {self.iterations}: the residual became {rms}: "
                "stopped; look for values in measurement and mask that are not finite, or change decoder.strengths"
            )
        if self.watch:
            self.watch(Iteration(iteration + 1, self.iterations, rms))
        return self.tolerance is not None and rms < self.tolerance
