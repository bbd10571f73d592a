"""Carry-over: readout does not empty the pixels completely."""

from __future__ import annotations

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.free_form.free_form import Empirical
from sci_lightning.encoder.signal import Signal


class CarryOver(Empirical, SensorEffect):
    """A part c0 of what was recorded is added to the next capture of the file.

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
        if signal.recorded_before is None:
            return signal
        return signal.with_mean(signal.mean + self.coefficients.to(signal.mean) * signal.recorded_before)
