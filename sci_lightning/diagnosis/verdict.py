"""The verdict of a diagnosis: what held-out misfit chance allows, and which of the four words follows from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from scipy.stats import chi2 as chi2_distribution

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.residual_tests.residual_test import SIGNIFICANT

NEGLIGIBLE = 1.05
"""Reduced chi2 on held-out pixels that is of no practical relevance, however many pixels prove that it is above 1."""
FAR = 4.0
"""Root mean squares beyond which a residual counts as this far, so that no outlier widens the limit it is held to."""
EXACT = 2.0
"""Variance of the square of a standard normal number: that of a randomised quantile residual of an exact model."""


def chi2_limit(fitter: Fitter, fit: Fit, residual: torch.Tensor, which: torch.Tensor) -> float:
    """Return the largest reduced chi2 that a right model reaches by chance on so many pixels.

    The statistic is the mean c of the squared quantile residuals of n pixels. With a right model it follows
    approximately a gamma distribution, which two moments determine:

    - mean: 1 + p / m, because the p parameters were estimated from m other pixels (1 if these are the same pixels);
    - variance: v / n + 2 q / m + 2 sum_c [(sum_i a_i)^2 - sum_i a_i^2] / n^2. Here v is the variance of a squared
      residual relative to its mean, estimated from the residuals themselves: it is 2 if signal and noise are Gaussian
      and more for a few photons or electrons. q counts noise levels that were estimated. The last term is there if a
      fixed-pattern map was estimated: its error is common to the pixels i that share a map value c, and a_i is that
      error's part of the predicted variance of pixel i.

    The effective number of degrees of freedom is f = 2 mean^2 / variance, and the limit is mean * Q(f) / f, where Q is
    the quantile of chi2 that one right model in a thousand exceeds (``SIGNIFICANT``, as for the residual tests). It is
    never below ``NEGLIGIBLE``, which it falls to from about 7,700 pixels on.

    Args:
        fitter: of the captures.
        fit: the model that the residuals belong to.
        residual: ``(N, H, W)`` randomised quantile residuals.
        which: ``(N, H, W)`` bool, the pixels that chi2 is taken of.
    """
    count, fitted = float(which.sum()), float(fitter.use.sum())
    mean, variance = 1.0, variance_of_squares(residual[which]) / count
    if not (which & (fitter.use > 0)).any():
        mean += len(fit.free) / fitted
        variance += 2 * sum(fitter.model.known[effect].noise for effect, _ in fit.free) / fitted
        total = fitter.uncertain(fit.prediction, fit.charts).deviation.square()
        for chart in fit.charts.values():
            part = torch.where(which, chart.jacobian.square() * chart.variance.float() / total, 0.0).double()
            shared = chart.gather(part).square() - chart.gather(part.square())
            variance += 2 * float(shared.sum()) / count**2
    return max(NEGLIGIBLE, largest_by_chance(mean, variance))


def variance_of_squares(residual: torch.Tensor) -> float:
    """Return the variance of the squares of residuals ``(n,)`` relative to their mean; ``EXACT`` at least."""
    squares = residual.double().square()
    relative = (squares / squares.mean().clamp(min=1e-12)).clamp(max=FAR**2)
    return max(EXACT, float(relative.var(correction=0)))


def largest_by_chance(mean: float, variance: float) -> float:
    """Return what a positive number of this mean and variance, gamma distributed, exceeds once in a thousand times."""
    freedom = 2 * mean**2 / variance
    return mean * float(chi2_distribution.isf(SIGNIFICANT, freedom)) / freedom


def verdict(gaps: Mapping[str, Mapping[str, Any]], names: int, unnamed: int, structure: int) -> str:
    """Return ``consistent``, ``explained``, ``partly_explained`` or ``unexplained``.

    Nothing is left if the misfit is within what chance allows, nothing unnamed was found, and no residual test objects.
    Then the captures are ``consistent`` with the ideal camera, or ``explained`` by the effects named. Otherwise they
    are ``partly_explained`` if the effects named make the held-out pixels likelier. Likelihood decides here and not
    chi2, because chi2 rises towards 1 where the noise had been overestimated.

    Args:
        gaps: ``before`` and ``after``, see :func:`~sci_lightning.diagnosis.fit.gap.gap`.
        names: how many effects were named.
        unnamed: how many deviations without a name were found.
        structure: how many residual tests find more than noise.
    """
    after = gaps["after"]
    if within_chance(after) and not unnamed and not structure:
        return "explained" if names else "consistent"
    return "partly_explained" if names and after["nll"] < gaps["before"]["nll"] else "unexplained"


def within_chance(gap: Mapping[str, Any]) -> bool:
    """Return whether a gap's chi2 is one that a right model reaches by chance, or negligibly above 1."""
    return math.isfinite(gap["chi2"]) and gap["chi2"] <= gap["chi2_limit"]
