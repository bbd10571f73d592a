"""Response curve: the signal as a free function of the light."""

from __future__ import annotations

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.free_form.free_form import Empirical, piecewise_linear
from sci_lightning.encoder.signal import Signal


class ResponseCurve(Empirical, SensorEffect):
    """The signal plus a curve that connects the numbers, at equidistant levels from 0 to 1.

    Args:
        count: number of levels.
        values: the curve at these levels, fraction of full scale.
    """

    name = "response_curve"
    rank = 55.5
    where = "the response to light is curved"
    number = Parameter("1", 0.0, -1, 1, step=0.002)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 13

    def respond(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean + piecewise_linear(signal.mean, self.coefficients.to(signal.mean)))
