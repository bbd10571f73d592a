"""Are there codes that the converter never gives?"""

from __future__ import annotations

import math

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

REACH = 64
"""Codes to either side within which one that occurs must lie, for a code between to be missed."""
DRAWS = 4
"""Times that the captures are drawn from the model, to see how often it gives a code."""


def codes(residuals: Residuals) -> Answer:
    """Look for codes that never occur in the raw captures though the model gives them and codes to either side do.

    A code is missed as often as the model gives it or, if that is less, half as often as the rarer of its nearest
    neighbours occurs: a wrong mean alone leaves no code missing. How often a code occurs is Poisson-distributed.
    """
    observation = residuals.observation
    full = observation.full_scale
    counts = torch.bincount(observation.dn.flatten().long(), minlength=full + 1).double()
    missing = counts == 0
    index = torch.arange(full + 1)
    below = torch.where(missing, -REACH - 1, index).cummax(0).values
    above = torch.where(missing, full + REACH + 1, index).flip(0).cummin(0).values.flip(0)
    between = (missing & (index - below <= REACH) & (above - index <= REACH)).nonzero()[:, 0]
    neighbours = torch.minimum(counts[below[between]], counts[above[between]]) / 2
    missed = torch.minimum(_drawn(residuals)[between], neighbours)
    statistic = float(missed.max()) if len(missed) else 0.0
    shown = int((~missing).nonzero().max()) + 1
    picture = Picture(
        "curve", counts[:shown], unit="pixels", x=tuple(float(n) for n in range(shown)), axes=("code (DN)",)
    )
    return Answer(statistic, min(1.0, (full + 1) * math.exp(-min(statistic, 600.0))), statistic, picture)


def _drawn(residuals: Residuals) -> torch.Tensor:
    """Return how many pixels of every code the model gives with its converter."""
    full, prediction = residuals.observation.full_scale, residuals.prediction
    random = torch.Generator().manual_seed(residuals.seed)
    step = full / (2**prediction.bits - 1)
    count = torch.zeros(full + 1, dtype=torch.float64)
    for _ in range(DRAWS):
        noise = torch.randn(prediction.mean.shape, generator=random)
        signal = (prediction.mean + prediction.deviation * noise).clamp(0, full)
        drawn = ((signal / step).round() * step).round().long()
        count += torch.bincount(drawn.flatten(), minlength=full + 1)
    return count / DRAWS
