"""Row noise: every row has an offset of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import ChartEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.signal import Signal


class RowNoise(ChartEffect):
    """Offsets that are the same in every capture: ``std`` times a map (H, 1) of mean 0 and standard deviation 1.

    Args:
        std: standard deviation of the offsets, fraction of full scale, 0 to 1.
        size, file, seed: of the map, see :class:`ChartEffect`.
    """

    name = "row_noise"
    stage = "sensor"
    rank = 57
    about = {"std": Parameter("full scale", 0.0, 0, 1, step=0.001, starts=(0.005,))}
    sentence = "rows differ by offsets of {std} of full scale (standard deviation)"
    chart = "row"

    def respond(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean + self.std * signal.window(self.map))

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean - self.std * signal.window(self.map))
