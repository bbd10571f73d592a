"""Whether an operation is computed in bfloat16 or float16, for which other kernels are fastest than for float32."""

from __future__ import annotations

import torch

REDUCED = (torch.bfloat16, torch.float16)


def is_reduced(x: torch.Tensor) -> bool:
    """Return whether products of x are computed in bfloat16 or float16: because of its own type, or by autocast."""
    device = x.device.type
    return x.dtype in REDUCED or (device != "meta" and torch.is_autocast_enabled(device))
