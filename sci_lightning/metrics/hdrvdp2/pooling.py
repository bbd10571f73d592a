"""From masked differences to one number."""

from __future__ import annotations

import numpy as np
import torch

FREQUENCIES = (0.1172, 0.2344, 0.4688, 0.9375, 1.875, 3.75, 7.5, 15.0, 30.0, 60.0)
WEIGHTS = (0.0, 0.0, 0.0003, 0.0003, 0.0398, 0.2690, 0.2142, 0.2832, 0.2832, 0.0)
"""Weight of a sub-band at these cycles per degree, straight in between."""
EPSILON = 1e-12


def pool(squares: list[torch.Tensor], frequencies: list[float]) -> torch.Tensor:
    """Q, (N,), from squared differences in each band (N, orientations, h, w); 100 where there are none.

    Each sub-band gives the root of its sum, not of its mean, over its number of pixels.
    """
    q = torch.full((len(squares[0]),), 100.0, dtype=squares[0].dtype, device=squares[0].device)
    for band, rho in zip(squares, frequencies, strict=True):
        total = band.sum((-2, -1))
        root = torch.where(total > 0, total, 1.0).sqrt() * (total > 0)  # whose gradient at 0 is 0, not undefined
        pooled = root / band[0, 0].numel()
        q = q - float(np.interp(rho, FREQUENCIES, WEIGHTS)) * torch.log1p(pooled / EPSILON).sum(1)
    return q
