"""Source power: the light differs from capture to capture."""

from __future__ import annotations

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.empirical.empirical import Empirical
from sci_lightning.encoder.signal import Signal


class SourcePower(Empirical):
    """Capture n receives 1 + c_n times its light. It belongs to a set of captures, not to the camera.

    Args:
        count: N.
        values: c.
    """

    name = "source_power"
    stage = "exposure"
    rank = 34
    where = "captures as a whole receive more or less light than others"
    number = Parameter("1", 0.0, -1, 4, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return captures

    def form(self, signal: Signal) -> Signal:
        if len(signal.mean) != self.count:
            return signal
        return signal.with_mean(signal.mean * (1 + self.coefficients.to(signal.mean))[:, None, None])
