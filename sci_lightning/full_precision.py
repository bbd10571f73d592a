"""What keeps float32 under mixed precision: the camera, the data steps, and what is measured of the estimate."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import torch

DEVICES = ("cpu", "cuda", "mps")
"""Kinds of devices whose automatic casts are switched off."""


@contextmanager
def full_precision() -> Iterator[None]:
    """Compute in the precision of the tensors, as a ``with`` block or a decorator, whatever ``torch.autocast`` says.

    Masks, sensors, effects, data steps, losses and metrics differ by less than what bfloat16 rounds away. Only networks
    gain by it.

    Example:
        >>> import torch
        >>> a = torch.ones(2, 2)
        >>> with torch.autocast("cpu", torch.bfloat16):
        ...     mixed = a @ a
        ...     with full_precision():
        ...         full = a @ a
        >>> mixed.dtype, full.dtype
        (torch.bfloat16, torch.float32)
    """
    with ExitStack() as stack:
        for device in DEVICES:
            if torch.is_autocast_enabled(device):
                stack.enter_context(torch.autocast(device, enabled=False))
        yield
