"""Row gain: every row has a gain of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import FixedPatternGain
from sci_lightning.encoder.effects.parameter import Parameter


class RowGain(FixedPatternGain):
    """The signal of every row is multiplied by 1 + a number of its own.

    Args:
        std: standard deviation of the numbers, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "row_gain"
    rank = 51.6
    where = "rows differ in their gain"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    map_kind = "row"
