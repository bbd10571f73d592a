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
    return _block_answer(residuals.scaled.sum(0), len(residuals.raw), residuals.raw.numel())


def rows(residuals: Residuals) -> Answer:
    """Mean residual of every row."""
    return _line_answer(residuals.scaled.sum((0, 2)), residuals.raw[:, 0].numel(), residuals, "row (pixel)")


def columns(residuals: Residuals) -> Answer:
    """Mean residual of every column."""
    return _line_answer(residuals.scaled.sum((0, 1)), residuals.raw[:, :, 0].numel(), residuals, "column (pixel)")


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
    return judge(total / pixels.sqrt(), residuals.raw.numel(), picture)


def pixels(residuals: Residuals) -> Answer:
    """Mean residual of every single pixel."""
    scores = residuals.scaled.sum(0) / len(residuals.raw) ** 0.5
    return judge(scores, residuals.raw.numel(), Picture("map", scores, axes=PLACE))


def block_index(height: int, width: int) -> tuple[torch.Tensor, int, int]:
    """``(H, W)`` which block a pixel is in, and how many blocks there are down and across."""
    side = max(LEAST, -(-max(height, width) // MOST))
    down, across = -(-height // side), -(-width // side)
    index = (torch.arange(height) // side)[:, None] * across + (torch.arange(width) // side)[None]
    return index, down, across


def block_sums(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Sum of a ``(H, W)`` field over each block ``(h, w)`` float64, and how many pixels each has."""
    index, down, across = block_index(*field.shape)
    total = torch.bincount(index.flatten(), field.flatten().double(), minlength=down * across)
    size = torch.bincount(index.flatten(), minlength=down * across).double()
    return total.reshape(down, across), size.reshape(down, across)


def _block_answer(field: torch.Tensor, captures: int, pixels: int) -> Answer:
    total, size = block_sums(field)
    scores = total / (size * captures).sqrt()
    height, width = field.shape
    picture = Picture("map", scores, axes=PLACE, extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    return judge(scores, pixels, picture)


def _line_answer(total: torch.Tensor, pixels: int, residuals: Residuals, axis: str) -> Answer:
    picture = Picture(
        "curve",
        total / pixels,
        unit="mean residual (σ)",
        x=tuple(float(n) for n in range(len(total))),
        axes=(axis,),
        errors=torch.full((len(total),), pixels**-0.5),
    )
    return judge(total / pixels**0.5, residuals.raw.numel(), picture)
