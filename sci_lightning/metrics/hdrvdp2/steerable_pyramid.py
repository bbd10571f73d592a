"""The steerable pyramid: an image split into bands of spatial frequency and orientation.

Its filters are those with four orientations (Simoncelli and Freeman, 1995; "sp3" of their program). Only the taps that
do not follow from symmetry are listed: one octant of round filters, from the corner to the middle of the edges, and of
the oriented ones the parts that are named below.
"""

from __future__ import annotations

import torch
from scipy.fft import next_fast_len
from torch.nn import functional as F

from sci_lightning.metrics.hdrvdp2.transforms import precomputed, spectrum, upper_left

LOW_START = (
    (-8.7009997515e-05, -0.0013542800443, -0.001601260039, -0.00050337001448, 0.0025240099058),
    (0.0029215801042, 0.0075227199122, 0.0082244202495, 0.0011076199589),
    (-0.007061290089, -0.037694871426, -0.032971370965),
    (0.043813198805, 0.181160301),
    (0.4376249909,),
)
HIGH_START = (
    (
        *(-0.000404839986, -0.00062596000498, -3.7829999201e-05, 0.00088387000142),
        *(0.0015450799838, 0.0019235999789, 0.0020687500946, 0.0020898699295),
    ),
    (
        *(-0.00032734998967, 0.00077435001731, 0.0015874400269, 0.0021750701126),
        *(0.0025626500137, 0.0022892199922, 0.0019755100366),
    ),
    (0.0011793200392, 0.0014050999889, 0.0022253401112, 0.0021145299543, 0.00033578000148, -0.00083368999185),
    (0.0012960999738, -0.00049274001503, -0.0031295299996, -0.0045751798898, -0.0051014497876),
    (-0.0063222697936, -0.0027556000277, 0.0053632198833, 0.0073032598011),
    (0.013962360099, 0.0078046298586, -0.0093812197447),
    (-0.079501636326, -0.1554141641),
    (0.7303866148,),
)
LOW = (
    (
        *(-4.3500000174e-05, 0.00012078000145, -0.00067714002216, -0.00012434000382, -0.00080063997302),
        *(-0.0015970399836, -0.00025168000138, -0.00042019999819, 0.001261999947),
    ),
    (
        *(0.00044606000301, -0.00058146001538, 0.00056215998484, -0.00013688000035),
        *(0.0023255399428, 0.0028898599558, 0.0042872801423, 0.0055893999524),
    ),
    (
        *(0.0014607800404, 0.0021605400834, 0.0037613599561, 0.0030809799209),
        *(0.0041121998802, 0.0022212199401, 0.00055381999118),
    ),
    (0.0031757799443, 0.0031846798956, -0.0017774800071, -0.0074316998944, -0.0090569201857, -0.0096372198313),
    (-0.0035306399222, -0.012604200281, -0.018847439438, -0.017508180812, -0.016485679895),
    (-0.020229380578, -0.011091699824, 0.0039556599222, 0.014385120012),
    (0.021906599402, 0.068065837026, 0.090580143034),
    (0.1445499808, 0.1773651242),
    (0.2120374441,),
)
ACROSS = (
    (-0.00081125000725, 0.0039103501476, 0.0013462699717, 0.00074700999539),
    (0.0044451598078, 0.004456540104, -0.0037740699481, -0.00036522001028),
    (0.012316980399, -0.0058724298142, 0.0082581602037, -0.022522680461),
    (0.013955879956, -0.0028760801069, 0.039442278445, -0.1105690673),
    (0.01417945046, 0.0085267601535, 0.053605638444, -0.1768419296),
)
"""Upper left quarter, left of the middle column: odd from left to right, even from top to bottom."""
DIAGONAL = (
    (
        *(0.00082846998703, 5.7109999034e-05, -4.0110000555e-05, -0.0046670897864),
        *(-0.0080871898681, -0.014807609841, -0.0086204400286, 0.0031221499667),
    ),
    (0.00097479997203, 0.0069718998857, 0.002086560009, -0.002329879906, 0.0044814897701, -0.014917500317),
    (0.012145539746, 0.024427289143, -0.050797060132, -0.032785870135),
    (0.1510555595, 0.082495503128),
)
"""Right of the diagonal, down to where the other diagonal ends the row: even about that one, odd about the first."""


def round_filter(octant: tuple[tuple[float, ...], ...]) -> torch.Tensor:
    """Return all taps, float64 (n, n), of a filter that is symmetric under reflections and quarter turns."""
    middle = len(octant) - 1
    sides = torch.arange(2 * middle + 1).sub(middle).abs()
    away = torch.stack(torch.meshgrid(sides, sides, indexing="ij"))
    inner, outer = (middle - away).amax(0), (middle - away).amin(0)
    full = torch.tensor([(0.0,) * row + taps for row, taps in enumerate(octant)], dtype=torch.float64)
    return full[outer, inner]


def oriented_filters() -> torch.Tensor:
    """Return float64 (4, 9, 9): the derivatives across, along the falling diagonal, down, along the rising diagonal."""
    left = torch.tensor([*ACROSS, *ACROSS[-2::-1]], dtype=torch.float64)
    across = torch.cat((left, torch.zeros(9, 1, dtype=torch.float64), -left.flip(1)), 1)
    diagonal = torch.zeros(9, 9, dtype=torch.float64)
    for row, taps in enumerate(DIAGONAL):
        diagonal[row, row + 1 : row + 1 + len(taps)] = torch.tensor(taps, dtype=torch.float64)
    mirrored = diagonal.flip(0, 1).mT
    diagonal = torch.where(diagonal == 0, mirrored, diagonal)
    diagonal = diagonal - diagonal.mT
    return torch.stack((across, diagonal, -across.mT, diagonal.flip(1)))


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
    low = _spectrum(round_filter(LOW), REACH, field).unsqueeze(0)
    filters = torch.cat((_spectrum(oriented_filters(), REACH, field), low))
    if not first:
        return filters
    high = _spectrum(round_filter(HIGH_START), REACH + START_REACH, field).unsqueeze(0)
    return torch.cat((high, filters * _spectrum(round_filter(LOW_START), START_REACH, field)))


def _spectrum(taps: torch.Tensor, reach: int, field: tuple[int, int]) -> torch.Tensor:
    """Return the factor of a spectrum that means correlation with ``taps`` and removes a border of ``reach`` pixels."""
    before = reach - taps.shape[-1] // 2
    return spectrum(F.pad(taps, (before, 0, before, 0)), field).conj().resolve_conj()
