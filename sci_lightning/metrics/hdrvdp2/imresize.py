"""Bicubic resizing with MATLAB's rules (imresize), which no function of torch has."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from sci_lightning.metrics.hdrvdp2.tabulated import precomputed


def imresize(images: torch.Tensor, size: Sequence[int]) -> torch.Tensor:
    """Resize (..., H, W) to (..., *size) with a cubic of a = -0.5, widened for shrinking, and mirrored borders.

    At ratios other than powers of two the weights do not sum to 1, and are not normalised, as for the reference values.
    """
    down, across = (
        None if old == new else weights(images, old, new) for old, new in zip(images.shape[-2:], size, strict=True)
    )
    images = images if down is None else down @ images
    return images if across is None else images @ across.mT


@precomputed
def weights(old: int, new: int) -> torch.Tensor:
    """Return the matrix (new, old) that makes every new sample a weighted sum of the old ones."""
    scale = new / old
    stretch = min(scale, 1.0)
    centre = (torch.arange(new, dtype=torch.float64) + 0.5) / scale - 0.5
    reach = math.ceil(4 / stretch) + 2
    taps = (centre - 2 / stretch).floor()[:, None] + torch.arange(reach)
    tap_weights = stretch * cubic(stretch * (centre[:, None] - taps))
    index = taps.long() % (2 * old)
    index = torch.where(index < old, index, 2 * old - 1 - index)
    return torch.zeros(new, old, dtype=torch.float64).scatter_add_(1, index, tap_weights)


def cubic(x: torch.Tensor) -> torch.Tensor:
    """Return the cubic convolution kernel (Keys, 1981) with a = -0.5."""
    x = x.abs()
    near = (1.5 * x - 2.5) * x * x + 1
    far = ((-0.5 * x + 2.5) * x - 4) * x + 2
    return torch.where(x <= 1, near, torch.where(x <= 2, far, 0.0))
