"""Are the residuals spread like a bell, or are there too many far out?"""

from __future__ import annotations

import torch
from scipy.stats import ncx2

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

BINS = 40
"""Of equal probability."""
NEGLIGIBLE = 1e-4
"""Squared relative error of the bins' probabilities that is let pass: photon counts are not quite normal."""


def distribution(residuals: Residuals) -> Answer:
    """Histogram of the residuals' sizes against the standard normal: Pearson's chi2, a negligible difference allowed.

    Signs are left out: a mean that is wrong shows elsewhere, and the skewness of few photons is no fault.
    """
    found, expected = _histogram(residuals.raw)
    sizes = found[: BINS // 2].flip(0) + found[BINS // 2 :]
    statistic = float((sizes - 2 * expected).square().sum() / (2 * expected))
    freedom = BINS // 2 - 1
    middle = torch.special.ndtri((torch.arange(BINS, dtype=torch.float64) + 0.5) / BINS)
    picture = Picture(
        "curve",
        found / expected,
        unit="count (1 = as expected)",
        x=tuple(middle.tolist()),
        axes=("residual (σ)",),
        errors=torch.full((BINS,), expected**-0.5),
        middle=1.0,
    )
    count = residuals.raw.numel()
    nats = max(0.0, statistic - freedom) / 2
    return Answer(statistic, float(ncx2.sf(statistic, freedom, NEGLIGIBLE * count)), nats, picture)


def _histogram(raw: torch.Tensor) -> tuple[torch.Tensor, float]:
    """Residuals found in each bin, and expected in any."""
    edges = torch.special.ndtri(torch.arange(1, BINS, dtype=torch.float64) / BINS).float()
    return torch.bincount(torch.bucketize(raw.flatten(), edges), minlength=BINS).double(), raw.numel() / BINS
