"""Functions of luminance that are tabulated."""

from __future__ import annotations

import torch

DARKEST, BRIGHTEST = -5.0, 5.0
"""log10 of the luminances, in cd/m2, between which tables are kept."""


def log_luminances(points: int) -> torch.Tensor:
    """The ``points`` values of log10 luminance, equally far apart, at which a table is kept."""
    return torch.linspace(DARKEST, BRIGHTEST, points, dtype=torch.float64)


def look_up(table: torch.Tensor, log_luminance: torch.Tensor) -> torch.Tensor:
    """Values at ``log_luminance``, of any shape, straight between the points of ``table``, constant beyond its ends."""
    last = len(table) - 1
    place = (log_luminance.clamp(DARKEST, BRIGHTEST) - DARKEST) * (last / (BRIGHTEST - DARKEST))
    below = place.detach().long().clamp(max=last - 1)
    start = table[below]
    return start + (place - below) * (table[below + 1] - start)
