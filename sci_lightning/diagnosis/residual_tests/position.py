"""Is the misfit tied to places on the sensor, and are estimated maps as random as they should be?"""

from __future__ import annotations

import math

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, judge
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.search.map_test import map_p_value

MOST = 16
"""Blocks along either side, and rings around the centre."""
LEAST = 4
"""Pixels along the side of a block at least."""
PLACE = ("column (pixel)", "row (pixel)")


def blocks(residuals: Residuals) -> Answer:
    """Test the mean residual of square blocks of pixels."""
    total, size = block_sums(residuals.scaled.sum(0))
    scores = total / (size * len(residuals.raw)).sqrt()
    return judge(scores, Picture("map", scores, axes=PLACE, extent=extent(residuals)))


def rows(residuals: Residuals) -> Answer:
    """Test the mean residual of every row."""
    return _line_answer(residuals.scaled.sum((0, 2)), residuals.raw[:, 0].numel(), "row (pixel)", residuals.origin[0])


def columns(residuals: Residuals) -> Answer:
    """Test the mean residual of every column."""
    return _line_answer(
        residuals.scaled.sum((0, 1)), residuals.raw[:, :, 0].numel(), "column (pixel)", residuals.origin[1]
    )


def radius(residuals: Residuals) -> Answer:
    """Test the mean residual of rings around the image centre, of equal area."""
    count, height, width = residuals.raw.shape
    (top, left), (whole_height, whole_width) = residuals.origin, residuals.field
    y = torch.arange(top, top + height) - (whole_height - 1) / 2
    x = torch.arange(left, left + width) - (whole_width - 1) / 2
    distance = torch.hypot(y[:, None], x[None])
    ring = (distance.flatten().argsort().argsort() * MOST) // distance.numel()
    size = torch.bincount(ring, minlength=MOST).double()
    total = torch.bincount(ring, residuals.scaled.sum(0).flatten().double(), minlength=MOST)
    place = torch.bincount(ring, distance.flatten().double(), minlength=MOST) / size
    pixels = size * count
    picture = Picture(
        "curve",
        total / pixels,
        unit="mean residual (σ)",
        x=tuple(place.tolist()),
        axes=("distance from the image centre (pixel)",),
        errors=pixels.rsqrt(),
    )
    return judge(total / pixels.sqrt(), picture)


def pixels(residuals: Residuals) -> Answer:
    """Test the mean residual of every single pixel."""
    scores = residuals.scaled.sum(0) / len(residuals.raw) ** 0.5
    return judge(scores, Picture("map", scores, axes=PLACE, extent=extent(residuals)))


def block_sums(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the sum of a ``(H, W)`` field over every block, ``(h, w)`` float64, and the number of its pixels."""
    height, width = field.shape
    side = max(LEAST, -(-max(height, width) // MOST))
    down, across = -(-height // side), -(-width // side)
    index = (torch.arange(height) // side)[:, None] * across + (torch.arange(width) // side)[None]
    total = torch.bincount(index.flatten(), field.flatten().double(), minlength=down * across)
    size = torch.bincount(index.flatten(), minlength=down * across).double()
    return total.reshape(down, across), size.reshape(down, across)


def extent(residuals: Residuals) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top, in pixels of the field, of a map of the residuals."""
    (top, left), (height, width) = residuals.origin, residuals.raw.shape[-2:]
    return left - 0.5, left + width - 0.5, top + height - 0.5, top - 0.5


def _line_answer(total: torch.Tensor, pixels: int, axis: str, first: int) -> Answer:
    picture = Picture(
        "curve",
        total / pixels,
        unit="mean residual (σ)",
        x=tuple(float(n) for n in range(first, first + len(total))),
        axes=(axis,),
        errors=torch.full((len(total),), pixels**-0.5),
    )
    return judge(total / pixels**0.5, picture)


LEAST_DETERMINED = 0.1
"""Part of the prior's standard deviation that a map value's spread has at least when it is drawn."""


def estimated_map(residuals: Residuals, name: str) -> Answer:
    """Test an estimated map, see :func:`~sci_lightning.diagnosis.search.map_test.map_p_value`.

    A map absorbs whatever stays at its place: dust or a dead line too, whose values are not independent.
    """
    one = residuals.fit.maps[name]
    values = residuals.fit.hypothesis.maps[name].double()
    if one.kind == "smooth":
        p_value = map_p_value(one)
        nats = -math.log(max(p_value, 1e-300))
        return Answer(nats, p_value, nats, Picture("map", values, "part of the light", axes=PLACE))
    values = residuals.fitter.model.windowed(values)
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
