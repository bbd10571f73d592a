"""Values that depend on sizes and constants alone: made once, and looked up in tables of luminance."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps

import torch

DARKEST, BRIGHTEST = -5.0, 5.0
"""Range of the tables: log10 of luminance in cd/m2."""


def log_luminances(points: int) -> torch.Tensor:
    """Return the equally spaced values of log10 luminance of a table with so many points."""
    return torch.linspace(DARKEST, BRIGHTEST, points, dtype=torch.float64)


def look_up(table: torch.Tensor, log_luminance: torch.Tensor) -> torch.Tensor:
    """Return values at ``log_luminance``, of any shape: linear between the points of a table, constant beyond."""
    last = len(table) - 1
    place = (log_luminance.clamp(DARKEST, BRIGHTEST) - DARKEST) * (last / (BRIGHTEST - DARKEST))
    below = place.detach().long().clamp(max=last - 1)
    start = table[below]
    return start + (place - below) * (table[below + 1] - start)


def precomputed(make: Callable[..., torch.Tensor]) -> Callable[..., torch.Tensor]:
    """Decorate a function that returns float64 (or complex128) on the CPU, so that its values are computed once.

    The decorated function takes one more argument, the first: a tensor, on whose device and in whose precision the
    value is returned. Values are kept for every device, precision and set of arguments.
    """

    @lru_cache(maxsize=64)
    def made(device: torch.device, dtype: torch.dtype, *args: Hashable) -> torch.Tensor:
        with torch.inference_mode(False):  # a kept value must also serve calls with gradients
            value = make(*args)
            return value.to(device, dtype.to_complex() if value.is_complex() else dtype)

    @wraps(make)
    def alike(like: torch.Tensor, *args: Hashable) -> torch.Tensor:
        return made(like.device, like.dtype, *args)

    return alike
