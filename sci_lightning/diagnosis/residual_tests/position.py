"""Is the misfit tied to places on the sensor, the same in every capture?"""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge

MOST = 16
"""Blocks along either side, and rings around the centre."""
LEAST = 4
"""Pixels along the side of a block at least."""
PLACE = ("column (pixel)", "row (pixel)")


def blocks(residuals: Residuals) -> Answer:
    """Mean residual of square blocks of pixels."""
    total, size = block_sums(residuals.scaled.sum(0))
    scores = total / (size * len(residuals.raw)).sqrt()
    return judge(scores, Picture("map", scores, axes=PLACE, extent=extent(residuals.raw)))


def rows(residuals: Residuals) -> Answer:
    """Mean residual of every row."""
    return _line_answer(residuals.scaled.sum((0, 2)), residuals.raw[:, 0].numel(), "row (pixel)")


def columns(residuals: Residuals) -> Answer:
    """Mean residual of every column."""
    return _line_answer(residuals.scaled.sum((0, 1)), residuals.raw[:, :, 0].numel(), "column (pixel)")


def radius(residuals: Residuals) -> Answer:
    """Mean residual of rings around the image centre, of equal area."""
    count, height, width = residuals.raw.shape
    y = torch.arange(height) - (height - 1) / 2
    x = torch.arange(width) - (width - 1) / 2
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
    """Mean residual of every single pixel."""
    scores = residuals.scaled.sum(0) / len(residuals.raw) ** 0.5
    return judge(scores, Picture("map", scores, axes=PLACE))


def block_sums(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Sum of a ``(H, W)`` field over each block ``(h, w)`` float64, and how many pixels each has."""
    height, width = field.shape
    side = max(LEAST, -(-max(height, width) // MOST))
    down, across = -(-height // side), -(-width // side)
    index = (torch.arange(height) // side)[:, None] * across + (torch.arange(width) // side)[None]
    total = torch.bincount(index.flatten(), field.flatten().double(), minlength=down * across)
    size = torch.bincount(index.flatten(), minlength=down * across).double()
    return total.reshape(down, across), size.reshape(down, across)


def extent(field: torch.Tensor) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of what was summed over blocks of ``(.., H, W)``."""
    height, width = field.shape[-2:]
    return -0.5, width - 0.5, height - 0.5, -0.5


def _line_answer(total: torch.Tensor, pixels: int, axis: str) -> Answer:
    picture = Picture(
        "curve",
        total / pixels,
        unit="mean residual (σ)",
        x=tuple(float(n) for n in range(len(total))),
        axes=(axis,),
        errors=torch.full((len(total),), pixels**-0.5),
    )
    return judge(total / pixels**0.5, picture)
