"""The gap between prediction and captures on pixels that no fit has seen, and how large it may be by chance.

The verdict of a diagnosis rests on verification captures, which neither fits nor choices of a model have seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import torch
from scipy.stats import chi2 as chi2_distribution

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.likelihood import Prediction, quantile_residuals
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.free_form import FreeForm

CLIP_SIGMAS = 6.0
"""Standard deviations at which residuals are clipped, so that a few pixels do not hide all the others."""
OUTLIER_RMS = 4.0
"""Root mean squares beyond which a residual counts as this far, so that no outlier widens its own limit."""
GAUSSIAN_VARIANCE_OF_SQUARES = 2.0
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


@dataclass(frozen=True)
class Verification:
    """The misfit on captures that nothing has seen.

    Attributes:
        captures: their numbers in the file.
        before: gap of the ideal camera.
        after: gap of the corrected camera.
    """

    captures: tuple[int, ...]
    before: Gap
    after: Gap

    def describe(self) -> dict[str, Any]:
        """Return the verification as it stands in ``report.json``."""
        after = self.after.describe()
        return {
            **{name: after[name] for name in ("chi2", "rmse_dn", "nll", "pixels", "chi2_limit")},
            "captures": list(self.captures),
            "before": self.before.describe(),
        }


def held_out_gap(fit: Fit, seed: int, estimated_from: float | None = None) -> Gap:
    """Compare a fit with the held-out pixels: reduced chi2, error in DN and negative log-likelihood.

    With nothing held out (one capture of few pixels) the fitted pixels are taken.

    Args:
        fit: the model.
        seed: of the residuals' randomisation.
        estimated_from: how many pixels the model was fitted to; None for the fitted ones of its fitter.
    """
    fitter, prediction = fit.fitter, fit.uncertain_prediction
    observation = fitter.model.observation
    residual = residuals(fitter, prediction, seed)
    log_likelihood = fitter.log_likelihood(prediction)
    error = (fitter.dn - prediction.mean.clamp(0, observation.full_scale)).square()
    compared = (fitter.held_out if fitter.held_out.any() else fitter.fitted) > 0

    def misfit(pixels: torch.Tensor) -> Misfit:
        return Misfit(
            float(residual[pixels].square().mean()),
            float(error[pixels].mean().sqrt()),
            -float(log_likelihood[pixels].mean()),
        )

    by_kind = {}
    for kind in sorted(set(observation.kinds)):
        pixels = compared & torch.tensor([other == kind for other in observation.kinds])[:, None, None]
        if pixels.any():
            by_kind[kind] = misfit(pixels)
    limit = chi2_limit(fit, residual, compared, estimated_from)
    return Gap(**asdict(misfit(compared)), pixels=int(compared.sum()), chi2_limit=limit, by_kind=by_kind)


def residuals(fitter: Fitter, prediction: Prediction, seed: int) -> torch.Tensor:
    """Return randomised quantile residuals (K, h, w) of every pixel of the window, standard normal for a right model.

    Args:
        fitter: holds captures, split and model.
        prediction: with the uncertainty of its maps.
        seed: of the randomisation.
    """
    random = torch.Generator().manual_seed(seed)
    intervals = fitter.intervals(prediction.bits)
    return quantile_residuals(intervals, prediction, random)


def chi2_limit(fit: Fit, residual: torch.Tensor, pixels: torch.Tensor, estimated_from: float | None = None) -> float:
    """Return the largest reduced chi2 that a right model reaches by chance on so many pixels.

    The statistic is the mean c of the squared quantile residuals of n pixels. With a right model it follows
    approximately a gamma distribution, which two moments determine:

    - mean: 1 + p / m, because the p parameters were estimated from m other pixels (1 if these are the same pixels);
    - variance: v / n + 2 q / m + 2 sum_c [(sum_i a_i)^2 - sum_i a_i^2] / n^2. Here v is the variance of a squared
      residual relative to its mean, estimated from the residuals themselves: it is 2 if signal and noise are Gaussian
      and more for a few photons or electrons. q counts noise levels that were estimated. The last term is there if a
      fixed-pattern map was estimated: its error is common to the pixels i that share a map value c, and a_i is that
      error's part of the predicted variance of pixel i.

    Where the laboratory has errors, and none as large as it may be, captures of different targets disagree by more than
    that, and the square of the standard error by this disagreement, relative to their mean, is added.

    The effective number of degrees of freedom is f = 2 mean^2 / variance, and the limit is mean * Q(f) / f, where Q is
    the quantile of chi2 that one right model in a thousand exceeds (``SearchSettings.significance``, as for the
    residual tests). It is never below ``SearchSettings.negligible_chi2``, which it falls to from about 7,700 pixels on.

    Args:
        fit: the model that the residuals belong to.
        residual: ``(N, H, W)`` randomised quantile residuals.
        pixels: ``(N, H, W)`` bool, the pixels that chi2 is taken of.
        estimated_from: m; None for the number of the fitted pixels of its fitter.
    """
    fitter, settings = fit.fitter, fit.fitter.settings
    count = float(pixels.sum())
    fitted = float(fitter.fitted.sum()) if estimated_from is None else estimated_from
    mean, variance = 1.0, variance_of_squares(residual[pixels]) / count
    if not (pixels & (fitter.fitted > 0)).any():
        mean += len(fit.free) / fitted
        variance += 2 * sum(fitter.model.effects[effect].noise for effect, _ in fit.free) / fitted
        total = fit.uncertain_prediction.deviation.square()
        for one in fit.maps.values():
            part = torch.where(pixels, one.leverage / total, 0.0).double()
            variance += 2 * one.shared_variance(part) / count**2
    if fit.in_laboratory and not fit.beyond_laboratory:
        variance += scatter_of_captures(residual, pixels)
    return max(settings.negligible_chi2, largest_by_chance(mean, variance, settings.significance))


def scatter_of_captures(residual: torch.Tensor, pixels: torch.Tensor) -> float:
    """Return the squared standard error of a right model's reduced chi2 by how far captures disagree, 0 for one or two.

    What counts is the disagreement relative to their mean: where no capture fits, none is near 1 by chance either.
    """
    counts = pixels.sum((1, 2))
    squares = (residual.double().square() * pixels).sum((1, 2))[counts > 0] / counts[counts > 0]
    return float((squares / squares.mean().clamp(min=1)).var() / len(squares)) if len(squares) > 2 else 0.0


def variance_of_squares(residual: torch.Tensor) -> float:
    """Return the variance of the squares of residuals ``(n,)`` relative to their mean; 2 at least, as if Gaussian."""
    squares = residual.double().square()
    relative = (squares / squares.mean().clamp(min=1e-12)).clamp(max=OUTLIER_RMS**2)
    return max(GAUSSIAN_VARIANCE_OF_SQUARES, float(relative.var(correction=0)))


def largest_by_chance(mean: float, variance: float, probability: float = SearchSettings.significance) -> float:
    """Return what a gamma-distributed number of this mean and variance exceeds with this probability."""
    freedom = 2 * mean**2 / variance
    return mean * float(chi2_distribution.isf(probability, freedom)) / freedom


def verify(before: Fit, after: Fit, observation: Observation, seed: int) -> Verification:
    """Compare two fits with captures that they have not seen.

    Args:
        before: the ideal camera.
        after: the corrected camera.
        observation: the captures set aside.
        seed: of the residuals' randomisation.
    """
    unseen = after.fitter.of_captures(observation, fitted=False)
    estimated_from = float(after.fitter.fitted.sum())
    gaps = [held_out_gap(transferred(fit, unseen), seed, estimated_from) for fit in (before, after)]
    return Verification(tuple(sorted(observation.number.tolist())), *gaps)


def transferred(fit: Fit, fitter: Fitter) -> Fit:
    """Return a fit with what it predicts for the captures of another fitter.

    Free-form deviations that belong to the captures (the power of the source in each of them) are left out.
    """
    model, hypothesis = fitter.model, fit.hypothesis
    for name in fit.hypothesis.effects:
        effect = model.effects[name]
        if issubclass(effect, FreeForm) and effect.of_captures:
            hypothesis = hypothesis.without(name)
    prediction = model.predict(hypothesis)
    at = fitter.evaluate(hypothesis, prediction)
    maps = {name: one.of_other_captures(model, at) for name, one in fit.maps.items()}
    return replace(fit, fitter=fitter, hypothesis=hypothesis, prediction=prediction, maps=maps)
