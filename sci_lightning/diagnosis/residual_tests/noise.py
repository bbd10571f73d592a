"""Is the noise as strong as predicted, and are the residuals normal?"""

from __future__ import annotations

import torch
from scipy.stats import ncx2

from sci_lightning.diagnosis.residual_tests.position import PLACE, block_sums, extent
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, chi2_normal, judge
from sci_lightning.diagnosis.residual_tests.residuals import FEW, Residuals


def variance_by_intensity(residuals: Residuals) -> Answer:
    """Test the variance of the residuals about their mean at every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (
        residuals.by_level(values)
        for values in (residuals.raw, residuals.raw.double().square(), residuals.prediction.mean)
    )
    kept = count > FEW
    count, mean, squares, place = (values[kept] for values in (count, *(total / count for total in sums)))
    freedom = count - 1
    total = count * (squares - mean.square())
    picture = Picture(
        "curve",
        total / freedom,
        unit="variance (1 = as predicted)",
        x=tuple(place.tolist()),
        axes=("predicted signal (DN)",),
        errors=(2 / freedom).sqrt(),
        middle=1.0,
    )
    return judge(chi2_normal(total, freedom), picture)


def variance_by_position(residuals: Residuals) -> Answer:
    """Test the variance of the residuals in square blocks of pixels, about the mean of a pixel over the captures."""
    count = len(residuals.raw)
    raw = residuals.raw.double()
    spread = (raw - raw.mean(0)).square().sum(0) if count > 1 else raw.square().sum(0)
    total, size = block_sums(spread)
    freedom = size * max(count - 1, 1)
    unit = "log10 of variance (0 = as predicted)"
    picture = Picture("map", (total / freedom).log10(), unit, axes=PLACE, extent=extent(residuals))
    return judge(chi2_normal(total, freedom), picture)


BINS = 40
"""Bins of equal probability."""
NEGLIGIBLE_ERROR = 1e-4
"""Squared relative error of the bins' probabilities that is allowed: photon counts are not quite normal."""


def distribution(residuals: Residuals) -> Answer:
    """Compare the histogram of the residuals' absolute values with the standard normal, by Pearson's chi2.

    Signs are left out: a wrong mean shows in other tests, and the skewness of few photons is no fault. A negligible
    difference is allowed.
    """
    counts, expected = _histogram(residuals.raw)
    sizes = counts[: BINS // 2].flip(0) + counts[BINS // 2 :]
    statistic = float((sizes - 2 * expected).square().sum() / (2 * expected))
    freedom = BINS // 2 - 1
    middle = torch.special.ndtri((torch.arange(BINS, dtype=torch.float64) + 0.5) / BINS)
    picture = Picture(
        "curve",
        counts / expected,
        unit="count (1 = as expected)",
        x=tuple(middle.tolist()),
        axes=("residual (σ)",),
        errors=torch.full((BINS,), expected**-0.5),
        middle=1.0,
    )
    count = residuals.raw.numel()
    nats = max(0.0, statistic - freedom) / 2
    return Answer(statistic, float(ncx2.sf(statistic, freedom, NEGLIGIBLE_ERROR * count)), nats, picture)


def _histogram(raw: torch.Tensor) -> tuple[torch.Tensor, float]:
    """Return the number of residuals in every bin, and the number that is expected in any."""
    edges = torch.special.ndtri(torch.arange(1, BINS, dtype=torch.float64) / BINS).float()
    return torch.bincount(torch.bucketize(raw.flatten(), edges), minlength=BINS).double(), raw.numel() / BINS
