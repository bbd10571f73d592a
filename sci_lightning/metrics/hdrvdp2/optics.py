"""The eye's optics: light scattered on its way to the retina."""

from __future__ import annotations

import torch

from sci_lightning.metrics.hdrvdp2.fourier import frequencies, spectrum, upper_left
from sci_lightning.metrics.hdrvdp2.precomputed import precomputed

SURROUND = 1e-5
"""Luminance around the image, cd/m2."""

SHARE, DECAY = 0.99727370023777070, (0.028, 0.37, 37.0, 360.0)
GLARE_SHARE = 0.061466549455263
WEIGHTS = (0.426 * SHARE, 0.574 * SHARE, (1 - SHARE) * GLARE_SHARE, (1 - SHARE) * (1 - GLARE_SHARE))


def scatter(luminance: torch.Tensor, pixels_per_degree: float) -> torch.Tensor:
    """Luminance in cd/m2, (N, C, H, W), as it arrives on the retina; every border sees the dark surround."""
    height, width = size = luminance.shape[-2:]
    field = (2 * height, 2 * width)
    light = spectrum(luminance - SURROUND, field) * modulation_transfer(luminance, field, pixels_per_degree)
    return (SURROUND + upper_left(light, field, size)).clamp(1e-5, 1e10)


@precomputed
def modulation_transfer(field: tuple[int, int], pixels_per_degree: float) -> torch.Tensor:
    """``sum_k a_k exp(-b_k rho)`` with ``rho`` in cycles per degree; 1 at 0, so a uniform field stays as it is."""
    rho = frequencies(torch.zeros((), dtype=torch.float64), field, pixels_per_degree)
    return torch.stack([a * torch.exp(-b * rho) for a, b in zip(WEIGHTS, DECAY, strict=True)]).sum(0)
