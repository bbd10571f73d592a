"""Values that depend on sizes and constants alone: made once, and looked up in tables of luminance."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps

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


def precomputed(make: Callable[..., torch.Tensor]) -> Callable[..., torch.Tensor]:
    """Decorates a function that returns float64 (or complex128) on the CPU.

    What comes of it takes one argument more, the first: a tensor, on whose device and in whose precision the value is
    returned. The value is made once for each device, precision and set of arguments.
    """

    @lru_cache(maxsize=64)
    def made(device: torch.device, dtype: torch.dtype, *args: Hashable) -> torch.Tensor:
        with torch.inference_mode(False):  # kept for calls that need gradients, whoever asks first
            value = make(*args)
            return value.to(device, dtype.to_complex() if value.is_complex() else dtype)

    @wraps(make)
    def alike(like: torch.Tensor, *args: Hashable) -> torch.Tensor:
        return made(like.device, like.dtype, *args)

    return alike
