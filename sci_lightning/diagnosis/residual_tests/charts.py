"""Is an estimated map as random as the effect that it belongs to says?"""

from __future__ import annotations

import math

from sci_lightning.diagnosis.residual_tests.position import PLACE
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.search.map_check import p_value_of

LEAST = 0.1
"""Of a value, the part of its width that the captures must have told, for it to be drawn in full size."""


def chart(residuals: Residuals, name: str) -> Answer:
    """An estimated map against what it should be; see :func:`~sci_lightning.diagnosis.search.map_check.p_value_of`.

    A map takes up whatever stays at its place: dust or a dead line too, which do not look like that.
    """
    known = residuals.fit.charts[name]
    values = residuals.fit.hypothesis.charts[name].double()
    scores = values / (known.std**2 - known.variance).clamp(min=(LEAST * known.std) ** 2).sqrt()
    if known.kind == "hot":
        picture = Picture("map", values, "part of full scale", axes=PLACE)
    elif known.kind == "pixel":
        picture = Picture("map", scores, axes=PLACE)
    else:
        place = tuple(map(float, range(scores.numel())))
        picture = Picture("curve", scores.flatten(), x=place, axes=(PLACE[known.kind == "row"],))
    p_value = p_value_of(known)
    nats = -math.log(max(p_value, 1e-300))
    return Answer(nats, p_value, nats, picture)
