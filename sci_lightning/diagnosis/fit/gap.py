"""The gap between prediction and captures on pixels that no fit has seen, and how large it may be by chance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import torch
from scipy.stats import chi2 as chi2_distribution

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.likelihood import quantile_residuals
from sci_lightning.diagnosis.model.prediction import Prediction
from sci_lightning.diagnosis.search_settings import SearchSettings

OUTLIER = 4.0
"""Root mean squares beyond which a residual counts as this far, so that no outlier widens its own limit."""
GAUSSIAN = 2.0
"""Variance of the square of a standard normal number: that of a randomised quantile residual of an exact model."""


@dataclass(frozen=True)
class Misfit:
    """How far prediction and captures are apart on some pixels.

    Attributes:
        chi2: mean square of the randomised quantile residuals (reduced chi2); 1 when the model is right.
        rmse_dn: root mean square error, DN.
        nll: negative log-likelihood, nats per pixel.
    """

    chi2: float
    rmse_dn: float
    nll: float


@dataclass(frozen=True)
class Gap(Misfit):
    """The misfit on all held-out pixels, and what of it chance allows.

    Attributes:
        pixels: how many pixels were held out.
        chi2_limit: the largest reduced chi2 that a right model reaches by chance, see :func:`chi2_limit`.
        by_kind: the misfit for every kind of capture.
    """

    pixels: int
    chi2_limit: float
    by_kind: Mapping[str, Misfit] = field(default_factory=dict)

    @property
    def within_chance(self) -> bool:
        """Whether chi2 is one that a right model reaches by chance, or negligibly above 1; False where it is NaN."""
        return self.chi2 <= self.chi2_limit

    def describe(self) -> dict[str, Any]:
        """Return the gap as it stands in ``report.json``."""
        return asdict(self)


def held_out_gap(fitter: Fitter, fit: Fit, seed: int, estimated_from: float | None = None) -> Gap:
    """Compare a fit with the held-out pixels: reduced chi2, error in DN and negative log-likelihood.

    With nothing held out (one capture of few pixels) the fitted pixels are taken.

    Args:
        fitter: holds captures, split and model.
        fit: the model to be judged.
        seed: of the residuals' randomisation.
        estimated_from: how many pixels the model was fitted to; None for the fitted ones of ``fitter``.
    """
    observation = fitter.model.observation
    prediction = fitter.with_map_uncertainty(fit.prediction, fit.maps)
    residual = residuals(fitter, prediction, seed)
    log_likelihood = fitter.log_likelihood(prediction)
    error = (fitter.dn - prediction.mean.clamp(0, observation.full_scale)).square()
    judging = (fitter.held_out if fitter.held_out.any() else fitter.fitted) > 0

    def misfit(pixels: torch.Tensor) -> Misfit:
        return Misfit(
            float(residual[pixels].square().mean()),
            float(error[pixels].mean().sqrt()),
            -float(log_likelihood[pixels].mean()),
        )

    by_kind = {}
    for kind in sorted(set(observation.kinds)):
        pixels = judging & torch.tensor([other == kind for other in observation.kinds])[:, None, None]
        if pixels.any():
            by_kind[kind] = misfit(pixels)
    limit = chi2_limit(fitter, fit, residual, judging, estimated_from)
    return Gap(**asdict(misfit(judging)), pixels=int(judging.sum()), chi2_limit=limit, by_kind=by_kind)


def residuals(fitter: Fitter, prediction: Prediction, seed: int) -> torch.Tensor:
    """Return randomised quantile residuals (K, h, w) of every pixel of the window, standard normal for a right model.

    Args:
        fitter: holds captures, split and model.
        prediction: with the uncertainty of its maps.
        seed: of the randomisation.
    """
    random = torch.Generator().manual_seed(seed)
    intervals = fitter.intervals(prediction.bits)
    return quantile_residuals(intervals, prediction.mean, prediction.deviation, random, prediction.clipped)


def chi2_limit(
    fitter: Fitter, fit: Fit, residual: torch.Tensor, pixels: torch.Tensor, estimated_from: float | None = None
) -> float:
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
    the quantile of chi2 that one right model in a thousand exceeds (``SearchSettings.significance``, as for the
    residual tests). It is never below ``SearchSettings.negligible_chi2``, which it falls to from about 7,700 pixels on.

    Args:
        fitter: holds captures, split and model.
        fit: the model that the residuals belong to.
        residual: ``(N, H, W)`` randomised quantile residuals.
        pixels: ``(N, H, W)`` bool, the pixels that chi2 is taken of.
        estimated_from: m; None for the number of the fitted pixels of ``fitter``.
    """
    settings = fitter.settings
    count = float(pixels.sum())
    fitted = float(fitter.fitted.sum()) if estimated_from is None else estimated_from
    mean, variance = 1.0, variance_of_squares(residual[pixels]) / count
    if not (pixels & (fitter.fitted > 0)).any():
        mean += len(fit.free) / fitted
        variance += 2 * sum(fitter.model.effects[effect].noise for effect, _ in fit.free) / fitted
        total = fitter.with_map_uncertainty(fit.prediction, fit.maps).deviation.square()
        for one in fit.maps.values():
            part = torch.where(pixels, one.leverage / total, 0.0).double()
            variance += 2 * one.shared_variance(part) / count**2
    return max(settings.negligible_chi2, largest_by_chance(mean, variance, settings.significance))


def variance_of_squares(residual: torch.Tensor) -> float:
    """Return the variance of the squares of residuals ``(n,)`` relative to their mean; ``GAUSSIAN`` at least."""
    squares = residual.double().square()
    relative = (squares / squares.mean().clamp(min=1e-12)).clamp(max=OUTLIER**2)
    return max(GAUSSIAN, float(relative.var(correction=0)))


def largest_by_chance(mean: float, variance: float, probability: float = SearchSettings.significance) -> float:
    """Return what a gamma-distributed number of this mean and variance exceeds with this probability."""
    freedom = 2 * mean**2 / variance
    return mean * float(chi2_distribution.isf(probability, freedom)) / freedom
