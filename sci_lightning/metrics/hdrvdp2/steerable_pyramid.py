"""The steerable pyramid: an image split into bands of spatial frequency and orientation."""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch.nn import functional as F

from sci_lightning.metrics.hdrvdp2 import sp3_filters
from sci_lightning.metrics.hdrvdp2.fourier import spectrum, upper_left
from sci_lightning.metrics.hdrvdp2.tabulated import precomputed

SMALLEST = 17
"""Shortest side of an image from which a level is computed: the length of its longest filter."""
REACH, START_REACH = 8, 4
"""Reach in pixels of the filters of a level, and of the filter before the first level."""


def steerable_pyramid(images: torch.Tensor) -> list[torch.Tensor]:
    """Return the bands of images (N, H, W) from fine to coarse, each (N, orientations, h, w).

    The high residual (one orientation, full size), then per level four orientations, the first at full size and each
    further one half as large (rounded up), then the base (one orientation). Every level doubles the amplitude.
    """
    bands = []
    low = images
    for level in range(levels(*images.shape[-2:])):
        parts = _correlate(low, first=level == 0)
        if level == 0:
            bands.append(parts[:, :1])
        bands.append(parts[:, -5:-1])
        low = parts[:, -1, ::2, ::2]
    return [*bands, low.unsqueeze(1)]


def levels(height: int, width: int) -> int:
    """Return the number of levels with orientations for an image of this size."""
    side, count = min(height, width), 0
    while side >= SMALLEST:
        side, count = side // 2, count + 1
    return count


def _correlate(images: torch.Tensor, first: bool) -> torch.Tensor:
    """Correlate (N, H, W) with all filters of a level, (N, filters, H, W), at borders mirrored around their pixels."""
    height, width = size = images.shape[-2:]
    reach = REACH + START_REACH * first
    field = (next_fast_len(height + 2 * reach, real=True), next_fast_len(width + 2 * reach, real=True))
    mirrored = spectrum(F.pad(images, (reach,) * 4, mode="reflect"), field)
    return upper_left(mirrored.unsqueeze(1) * _filters(images, field, first), field, size)


@precomputed
def _filters(field: tuple[int, int], first: bool) -> torch.Tensor:
    """Return the spectra (filters, ..) of a level's filters: four orientations, then the low-pass to the next level.

    In the first level the filter of the high residual comes before them, and the others are combined with the low-pass
    filter that starts the pyramid. As that filter is even, mirrored borders stay mirrored behind it.
    """
    low = _spectrum(sp3_filters.round_filter(sp3_filters.LOW), REACH, field).unsqueeze(0)
    filters = torch.cat((_spectrum(sp3_filters.oriented_filters(), REACH, field), low))
    if not first:
        return filters
    high = _spectrum(sp3_filters.round_filter(sp3_filters.HIGH_START), REACH + START_REACH, field).unsqueeze(0)
    return torch.cat((high, filters * _spectrum(sp3_filters.round_filter(sp3_filters.LOW_START), START_REACH, field)))


def _spectrum(taps: torch.Tensor, reach: int, field: tuple[int, int]) -> torch.Tensor:
    """Return the factor of a spectrum that means correlation with ``taps`` and removes a border of ``reach`` pixels."""
    before = reach - taps.shape[-1] // 2
    return spectrum(F.pad(taps, (before, 0, before, 0)), field).conj().resolve_conj()
