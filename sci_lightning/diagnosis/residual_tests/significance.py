"""From standard normal scores to a p-value."""

from __future__ import annotations

import torch
from scipy.stats import chi2, norm

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture


def judge(scores: torch.Tensor, picture: Picture, *, dependent: bool = False) -> Answer:
    """An answer from scores, each standard normal when the model is right.

    Structure may be spread over all of them, which their sum of squares shows, or sit in one, which the largest
    shows: both are asked, and the smaller p-value counts, times two.

    Args:
        scores: any shape.
        picture: of them.
        dependent: whether they may depend on each other; then only the largest is asked (Bonferroni).
    """
    scores = scores[scores.isfinite()].double().flatten()
    if not len(scores):
        return Answer(0.0, 1.0, 0.0, picture)
    largest = float(scores.abs().max())
    alone = min(1.0, 2 * float(norm.sf(largest)) * len(scores))
    if dependent:
        return Answer(largest, alone, max(0.0, largest**2 - 1) / 2, picture)
    total = float(scores.square().sum())
    nats = max(0.0, total - len(scores)) / 2
    return Answer(total, min(1.0, 2 * min(alone, float(chi2.sf(total, len(scores))))), nats, picture)


def chi2_normal(total: torch.Tensor, freedom: torch.Tensor) -> torch.Tensor:
    """Standard normal scores of chi2-distributed sums, sign for too much or too little.

    Wilson and Hilferty's cube root (1931), which is exact to 1e-3 of a standard deviation from 30 degrees on.
    """
    spread = 2 / (9 * freedom)
    return ((total / freedom).pow(1 / 3) - (1 - spread)) / spread.sqrt()
