"""The steerable pyramid: an image taken apart by spatial frequency and orientation."""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch.nn import functional as F

from sci_lightning.metrics.hdrvdp2 import sp3_filters
from sci_lightning.metrics.hdrvdp2.fourier import spectrum, upper_left
from sci_lightning.metrics.hdrvdp2.tabulated import precomputed

SMALLEST = 17
"""A level is made of sides no shorter than this, its longest filter."""
REACH, START_REACH = 8, 4
"""How far, in pixels, the filters of a level reach, and the one that comes before the first level."""


def steerable_pyramid(images: torch.Tensor) -> list[torch.Tensor]:
    """Bands of (N, H, W) from fine to coarse, each (N, orientations, h, w).

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
    """How many levels with orientations an image of this size has."""
    side, count = min(height, width), 0
    while side >= SMALLEST:
        side, count = side // 2, count + 1
    return count


def _correlate(images: torch.Tensor, first: bool) -> torch.Tensor:
    """(N, H, W) with each filter of a level, (N, filters, H, W); borders are mirrored without repeating their pixel."""
    height, width = size = images.shape[-2:]
    reach = REACH + START_REACH * first
    field = (next_fast_len(height + 2 * reach, real=True), next_fast_len(width + 2 * reach, real=True))
    mirrored = spectrum(F.pad(images, (reach,) * 4, mode="reflect"), field)
    return upper_left(mirrored.unsqueeze(1) * _filters(images, field, first), field, size)


@precomputed
def _filters(field: tuple[int, int], first: bool) -> torch.Tensor:
    """Spectra (filters, ..) of a level's filters: four orientations, then the low-pass that leads to the next level.

    In the first level the high residual's comes before them, and they follow on the low-pass that starts the pyramid:
    that one is even, so what was mirrored at the borders still is behind it.
    """
    low = _spectrum(sp3_filters.round_filter(sp3_filters.LOW), REACH, field).unsqueeze(0)
    filters = torch.cat((_spectrum(sp3_filters.oriented_filters(), REACH, field), low))
    if not first:
        return filters
    high = _spectrum(sp3_filters.round_filter(sp3_filters.HIGH_START), REACH + START_REACH, field).unsqueeze(0)
    return torch.cat((high, filters * _spectrum(sp3_filters.round_filter(sp3_filters.LOW_START), START_REACH, field)))


def _spectrum(taps: torch.Tensor, reach: int, field: tuple[int, int]) -> torch.Tensor:
    """What correlation with ``taps`` multiplies a spectrum with; it takes off a border of ``reach`` on the way."""
    before = reach - taps.shape[-1] // 2
    return spectrum(F.pad(taps, (before, 0, before, 0)), field).conj().resolve_conj()
