"""What depends on sizes and constants alone is made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps

import torch


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
