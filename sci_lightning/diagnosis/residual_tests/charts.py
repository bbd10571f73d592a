"""Is an estimated map as random as the definition of its effect says?"""

from __future__ import annotations

import math

from sci_lightning.diagnosis.residual_tests.position import PLACE
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.search.map_test import map_p_value

LEAST_DETERMINED = 0.1
"""Part of the prior's standard deviation that a map value's spread has at least when it is drawn."""


def estimated_map(residuals: Residuals, name: str) -> Answer:
    """Test an estimated map, see :func:`~sci_lightning.diagnosis.search.map_test.map_p_value`.

    A map absorbs whatever stays at its place: dust or a dead line too, whose values are not independent.
    """
    one = residuals.fit.maps[name]
    values = residuals.fit.hypothesis.maps[name].double()
    scores = values / (one.std**2 - one.variance).clamp(min=(LEAST_DETERMINED * one.std) ** 2).sqrt()
    if one.kind == "hot":
        picture = Picture("map", values, "part of full scale", axes=PLACE)
    elif one.kind == "pixel":
        picture = Picture("map", scores, axes=PLACE)
    else:
        place = tuple(map(float, range(scores.numel())))
        picture = Picture("curve", scores.flatten(), x=place, axes=(PLACE[one.kind == "row"],))
    p_value = map_p_value(one)
    nats = -math.log(max(p_value, 1e-300))
    return Answer(nats, p_value, nats, picture)
