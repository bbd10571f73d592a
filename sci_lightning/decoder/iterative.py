"""The base class of decoders that iterate without training: the schedule, and when to stop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from copy import copy
from itertools import chain, count, repeat
from typing import NamedTuple

import torch

from sci_lightning.configuration.bounds import MOST_ITERATIONS, Iterations, Positive
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import Denoiser
from sci_lightning.decoder.denoiser.motion_filter import MotionFilter
from sci_lightning.errors import BadInput
from sci_lightning.full_precision import full_precision


class Iteration(NamedTuple):
    """The progress of an iterative decoder."""

    number: int
    """Number of the iteration, from 1."""
    of: int
    """Number of iterations in all."""
    residual: float
    """Root mean square of y - A x of the worst snapshot, in units of the measurement."""

    def __str__(self) -> str:
        return f"iteration {self.number} of {self.of}, residual {self.residual:.4f}"


class Iterative(Decoder):
    """Data steps and denoising in alternation, for any T, H and W.

    The data step divides by the sum of M squared, which is right for gray masks as well. Where no slot opens, the
    denoiser alone decides.

    Args:
        denoiser: the prior.
        strengths: strengths of the denoiser, one after another.
        iterations: number of iterations with each of the strengths.
        tolerance: the decoder stops when the root mean square of y - A x is below it in every snapshot, in units of
            the measurement; the standard deviation of the noise is a good choice. None: all iterations are made.
        start: another decoder, whose estimate is the first one. None: the mean frame in every slot.
        motion: filter behind the denoiser in every iteration, for denoisers that take every frame by itself. None: no
            filter.

    Raises:
        BadInput: a setting is not positive, or strengths and iterations differ in number; in a call, the residual is
            no longer finite.
    """

    global_steps = True  # watched after every iteration, with its Iteration

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
        self.published_names = names  # type: ignore[misc]  # of the class elsewhere, here of the denoiser
        self.plan = tuple(zip(strengths, iterations, strict=True))
        """Pairs of a strength and its number of iterations."""
        self.tolerance = tolerance
        self.start = start
        self.motion = motion
        self._denoisers: list[Denoiser] = []

    @property
    def halo(self) -> int:
        """Pixels around a tile that the denoiser needs: only the denoiser works tile by tile."""
        return self.denoiser.receptive_field

    @property
    def alignment(self) -> int:
        """Tiles begin at multiples of so many pixels."""
        return self.denoiser.alignment

    def abridged(self) -> Decoder:
        """Return the decoder with one iteration, which has all that an iteration can have."""
        decoder = copy(self)
        decoder.plan = ((self.plan[0][0], 1),)
        decoder.watch = None
        decoder._modules = dict(self._modules)
        if self.motion is not None:
            decoder.motion = copy(self.motion)
            decoder.motion.after, decoder.motion.reach = 0, min(1, self.motion.reach)
        if self.start is not None:
            decoder.start = self.start.abridged()
        return decoder

    def counted(self) -> Decoder:
        """Return the decoder without its motion filter, which only compares and averages."""
        decoder = copy(self)
        decoder.watch = None
        decoder._modules = dict(self._modules)
        decoder.motion = None
        if self.start is not None:
            decoder.start = self.start.counted()
        return decoder

    def first_estimate(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the video ``(N, T, H, W)`` from which the iteration starts."""
        if self.start is None:
            video = self.operator(mask).mean_video(measurement)
            return video if torch.is_grad_enabled() else video.contiguous()
        self.start.watch = self.watch
        if self._tiling is None:
            return self.start(measurement, mask)
        return self.start.in_tiles(measurement, mask, self._tiling)

    def schedule(self) -> Iterator[tuple[int, float]]:
        """Yield number (from 0) and strength of every iteration, after a reset of denoiser and motion filter."""
        self.denoiser.reset()
        self._denoisers = []
        if self.motion is not None:
            self.motion.reset()
        return enumerate(chain.from_iterable(repeat(strength, number) for strength, number in self.plan))

    @property
    def iterations(self) -> int:
        """Number of iterations in all."""
        return sum(number for _, number in self.plan)

    def denoised(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Return the video ``(N, T, H, W)`` after the denoiser and the motion filter."""
        denoisers = self._one_for_every_tile()
        learned = next(self.denoiser.parameters(), None) is not None
        with nullcontext() if learned else full_precision():
            video = self.locally(lambda part: next(denoisers)(part, strength), self.halo, video)
        if self.motion is None:
            return video
        with full_precision():
            return self.motion(video)

    def _one_for_every_tile(self) -> Iterator[Denoiser]:
        """Yield denoisers of the same weights for one tile after another, which keep what they know of their tile."""
        if self._tiling is None:
            yield self.denoiser
        for number in count():
            if number == len(self._denoisers):
                self._denoisers.append(copy(self.denoiser))
            yield self._denoisers[number]

    def reached(self, residual: torch.Tensor, iteration: int) -> bool:
        """Return whether to stop after ``iteration`` (from 0), whose y - A x is ``residual``, ``(N, H, W)``.

        Raises:
            BadInput: the residual is not finite.
        """
        if residual.is_meta:  # no values, because operations are being counted
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


def reused(x: torch.Tensor) -> torch.Tensor | None:
    """Return the memory of an estimate that is not needed any more, for the next one; None where gradients need it."""
    return None if torch.is_grad_enabled() else x
