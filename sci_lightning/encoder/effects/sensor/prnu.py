"""Photo-response non-uniformity (PRNU): every pixel has a gain of its own."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import FixedPatternGain
from sci_lightning.encoder.effects.parameter import Parameter


class Prnu(FixedPatternGain):
    r"""Light times :math:`1 + s\, c`, the map c the same in every capture, of mean 0 and standard deviation 1.

    Args:
        std: s, standard deviation of the gains, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "prnu"
    rank = 51
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    sentence = "pixels differ in gain by {std} (standard deviation)"
    map_kind = "pixel"
