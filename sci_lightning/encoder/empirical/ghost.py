"""Ghost: a faint second image, displaced."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.empirical.empirical import Empirical
from sci_lightning.encoder.signal import Signal


class Ghost(Empirical, OpticsEffect):
    """A part c0 of the light forms a second image, displaced by (c1, c2) pixels, +x right and +y down.

    Args:
        count: 3.
        values: part, dx, dy.
    """

    name = "ghost"
    rank = 44
    where = "a second image lies beside the first"
    number = Parameter("part; pixel; pixel", 0.0, -1024, 1024, step=0.01)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 3

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        part, dx, dy = self.coefficients.to(signal.mean)
        height, width = signal.mean.shape[-2:]
        ghost = _moved(height, dy) @ signal.mean @ _moved(width, dx).T
        return signal.with_mean((1 - part) * signal.mean + part * ghost)


def _moved(length: int, distance: torch.Tensor) -> torch.Tensor:
    """``(length, length)``: linear interpolation along one axis, dark beyond."""
    place = torch.arange(length).to(distance)
    return (1 - (place[:, None] - place - distance).abs()).clamp(min=0)
