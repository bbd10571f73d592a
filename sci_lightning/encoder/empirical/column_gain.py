"""Column gain: every column has a gain of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import ChartEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.signal import Signal


class ColumnGain(ChartEffect):
    """Light times 1 + a number for every column.

    Args:
        std: standard deviation of the numbers, 0 to 1.
        size, file, seed: of the map, see :class:`ChartEffect`.
    """

    name = "column_gain"
    stage = "sensor"
    rank = 51.5
    where = "columns differ in their gain"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    chart = "column"

    def respond(self, signal: Signal) -> Signal:
        gain = 1 + self.std * signal.window(self.map)
        return signal.with_moments(signal.mean * gain, signal.variance * gain.square())
