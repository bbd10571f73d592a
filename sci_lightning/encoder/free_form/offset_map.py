"""Offset map: every pixel has an offset of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import FixedPatternOffset
from sci_lightning.encoder.effects.parameter import Parameter


class OffsetMap(FixedPatternOffset):
    """Every pixel's signal plus a number of its own, the same in every capture.

    Args:
        std: standard deviation of the numbers, fraction of full scale, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "offset_map"
    rank = 57.5
    where = "pixels differ in their offset"
    about = {"std": Parameter("full scale", 0.0, 0, 1, step=0.0005, starts=(0.005,))}
    map_kind = "pixel"
