"""Visual masking of the differences between two images, band by band, and pooling to one number."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.metrics.hdrvdp2.imresize import imresize

P, Q = 10**0.544068, 10**0.49576
SELF, ORIENTATIONS, NEIGHBOURS = 10**0.189065, 10**0.449199, 10**1.52512
"""Weights of masking by the band itself, by the other orientations, and by the neighbouring bands."""


def masked_differences(
    test: list[torch.Tensor], reference: list[torch.Tensor], sensitivity: list[torch.Tensor]
) -> list[torch.Tensor]:
    """Return the squared differences in units of their visibility threshold, for every band of two pyramids.

    Args:
        test, reference: bands (N, orientations, h, w) from fine to coarse.
        sensitivity: (N, 1, h, w) for every band, the inverse of the neural noise in it.
    """
    contrast = [_blur(torch.minimum(t.abs(), r.abs())) for t, r in zip(test, reference, strict=True)]
    differences = []
    for band, (t, r, s, own) in enumerate(zip(test, reference, sensitivity, contrast, strict=True)):
        gain = 2.0**band
        masking = SELF * (own * s / gain) ** Q
        if own.shape[1] > 1:
            masking = masking + ORIENTATIONS * ((own.sum(1, keepdim=True) - own).clamp(min=0) * s / gain) ** Q
        masking = gain * (masking + NEIGHBOURS * (_neighbours(contrast, band) * s) ** Q)
        excitation = gain**2 * ((t - r).abs() / gain) ** (2 * P)
        differences.append(excitation / (s ** (-2 * P) + masking**2))
    return differences


def _neighbours(contrast: list[torch.Tensor], band: int) -> torch.Tensor:
    """Return the contrast of the bands next to this one, resized to it; the base band masks only itself."""
    size, orientations = contrast[band].shape[-2:], contrast[band].shape[1]
    total = torch.zeros_like(contrast[band])
    for other, gain in ((band - 1, 2.0 ** (band - 1)), (band + 1, 2.0 ** (band + 1))):
        if 0 <= other < len(contrast) - 1:
            total = total + imresize(contrast[other][:, :orientations], size).clamp(min=0) / gain
    return total


def _blur(images: torch.Tensor) -> torch.Tensor:
    """Return the 3 x 3 mean, with zeros around."""
    return F.avg_pool2d(images, 3, stride=1, padding=1)


FREQUENCIES = (0.1172, 0.2344, 0.4688, 0.9375, 1.875, 3.75, 7.5, 15.0, 30.0, 60.0)
WEIGHTS = (0.0, 0.0, 0.0003, 0.0003, 0.0398, 0.2690, 0.2142, 0.2832, 0.2832, 0.0)
"""Weights of sub-bands at these frequencies in cycles per degree; linear interpolation in between."""
EPSILON = 1e-12


def pool(squares: list[torch.Tensor], frequencies: list[float]) -> torch.Tensor:
    """Return Q, (N,), from squared differences in all bands (N, orientations, h, w); 100 where there are none.

    A sub-band contributes the root of its sum, not of its mean, divided by its number of pixels.
    """
    q = torch.full((len(squares[0]),), 100.0, dtype=squares[0].dtype, device=squares[0].device)
    for band, rho in zip(squares, frequencies, strict=True):
        total = band.sum((-2, -1))
        root = torch.where(total > 0, total, 1.0).sqrt() * (total > 0)  # so that the gradient at 0 is 0, not undefined
        pooled = root / band[0, 0].numel()
        q = q - float(np.interp(rho, FREQUENCIES, WEIGHTS)) * torch.log1p(pooled / EPSILON).sum(1)
    return q
