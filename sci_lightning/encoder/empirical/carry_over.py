"""Carry-over: readout does not empty the pixels completely."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.empirical.empirical import Empirical
from sci_lightning.encoder.signal import Signal


class CarryOver(Empirical, SensorEffect):
    """A part c0 of every capture's signal is added to the next capture of the file.

    Args:
        count: 1.
        values: c0.
    """

    name = "carry_over"
    rank = 55.7
    where = "a part of each capture is left over in the next"
    number = Parameter("1", 0.0, -1, 1, step=0.001)
    of_captures = True

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return min(1, captures - 1)

    def respond(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        follows = (signal.position[:, None] == signal.position + 1).to(signal.mean)  # (capture, its predecessor)
        left = torch.einsum("ij,jhw->ihw", follows, signal.mean)
        return signal.with_mean(signal.mean + self.coefficients.to(signal.mean) * left)
