"""Column noise: every column has an offset of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import FixedPatternOffset
from sci_lightning.encoder.effects.parameter import Parameter


class ColumnNoise(FixedPatternOffset):
    """Offsets that are the same in every capture: ``std`` times a map (1, W) of mean 0 and standard deviation 1.

    Args:
        std: standard deviation of the offsets, fraction of full scale, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "column_noise"
    rank = 56
    about = {"std": Parameter("full scale", 0.0, 0, 1, step=0.001, starts=(0.005,))}
    sentence = "columns differ by offsets of {std} of full scale (standard deviation)"
    map_kind = "column"
    centred_by = "black_level"
