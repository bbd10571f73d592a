"""The residuals of a fit that every test looks at, and what the model says about the pixels they come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.gap import CLIP_SIGMAS, residuals
from sci_lightning.diagnosis.model.fixed_pattern_map import with_map_uncertainty
from sci_lightning.diagnosis.model.likelihood import Prediction
from sci_lightning.diagnosis.model.observation import Observation

PRIOR_PIXELS = 30
"""Pixels that the common variance counts as, when the variance of a level of signal is estimated."""
MIN_VARIANCE = 1e-4
"""Smallest variance of residuals that is divided by."""
ROUNDING_SHARE = 1e-4
"""Part of full scale by which equal signals may differ through rounding."""
SIGNAL_LEVELS = 32
"""Groups of pixels of about equal predicted signal."""
BRIGHT_QUANTILES = (0.985, 0.995, 0.999)
"""Parts of all pixels at which the brightest group is divided further: saturation begins there."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of a fit at the pixels that count: ``(N, H, W)`` is the field without the border.

    Attributes:
        fit: the fitted model.
        raw: ``(N, H, W)`` randomised quantile residuals, standard normal when the model is right.
        prediction: mean and deviation, see :func:`predict_ahead`.
        seed: of the randomisation.
    """

    fit: Fit
    raw: torch.Tensor
    prediction: Prediction
    seed: int

    @staticmethod
    def of(fit: Fit, seed: int) -> Residuals:
        """Return the residuals of a fit for all pixels, fitted and held out."""
        prediction = predict_ahead(fit)
        raw = residuals(fit.fitter, prediction, seed)
        return Residuals(fit, raw, replace(prediction, clipped=None), seed)

    @cached_property
    def observation(self) -> Observation:
        """The captures, without the border, and with the scenes as they are by the fitted model."""
        model = self.fit.fitter.model
        shown = replace(model.observation, scene=model.scenes(self.fit.hypothesis))
        return shown.window(*self.fit.fitter.split.window)

    @property
    def origin(self) -> tuple[int, int]:
        """(row, column) of the first pixel within the field."""
        rows, columns = self.fit.fitter.split.window
        return rows.start, columns.start

    @property
    def field(self) -> tuple[int, int]:
        """(H, W) of the field with its border."""
        return self.fit.fitter.model.observation.size

    @cached_property
    def level(self) -> torch.Tensor:
        """``(N, H, W)`` number of a pixel's group by predicted signal: equal groups, smaller ones at the bright end."""
        mean = self.prediction.mean
        sample = mean.flatten()[:: max(1, mean.numel() // 100_000)].sort().values
        shares = torch.cat((torch.arange(1, SIGNAL_LEVELS) / SIGNAL_LEVELS, torch.tensor(BRIGHT_QUANTILES)))
        edges = sample[(shares * (len(sample) - 1)).round().long()].unique()
        edges = edges + ROUNDING_SHARE * self.observation.full_scale  # many pixels of even scenes lie right at an edge
        return torch.bucketize(mean, edges, right=True)

    @cached_property
    def scale(self) -> torch.Tensor:
        """``(N, H, W)`` factor of the residuals for tests of the mean.

        With it every level of signal and every capture has the observed variance 1, so that noise of a wrong strength
        is not mistaken for structure of the mean.
        """
        clipped = self.clipped
        count, total, squares = (self.by_level(values) for values in (None, clipped, clipped.square()))
        common = clipped.square().mean()
        about_mean = squares - total.square() / count.clamp(min=1)
        variance = (about_mean + PRIOR_PIXELS * common) / (count.clamp(min=1) - 1 + PRIOR_PIXELS)
        scale = variance.clamp(min=MIN_VARIANCE).rsqrt().float()[self.level]
        return scale * (clipped * scale).square().mean((1, 2), keepdim=True).clamp(min=MIN_VARIANCE).rsqrt()

    @property
    def clipped(self) -> torch.Tensor:
        """``(N, H, W)`` residuals, clipped at ``CLIP_SIGMAS`` standard deviations."""
        return self.raw.clamp(-CLIP_SIGMAS, CLIP_SIGMAS)

    @cached_property
    def scaled(self) -> torch.Tensor:
        """``(N, H, W)`` residuals for tests of the mean: clipped and scaled."""
        return self.clipped * self.scale

    def by_level(self, values: torch.Tensor | None) -> torch.Tensor:
        """Return the sum of values over the pixels of every level, or their number: ``(levels,)`` float64."""
        weights = None if values is None else values.flatten().double()
        return torch.bincount(self.level.flatten(), weights, minlength=int(self.level.max()) + 1).double()

    @cached_property
    def sensitivity(self) -> torch.Tensor:
        """``(N, H, W)`` derivative of :attr:`scaled` with respect to the signal, which is 1 at full scale."""
        mean, full = self.prediction.mean, self.observation.full_scale
        deviation = (self.prediction.deviation.square() + 1 / 12).sqrt()
        derivative = full / deviation * self.scale
        return torch.where((mean > 0) & (mean < full), derivative, 0.0)

    @cached_property
    def images(self) -> torch.Tensor:
        """``(P, H, W)`` images of the patterns on the pixels, as the model predicts them."""
        path = self.fit.fitter.model.path(self.fit.hypothesis)
        with torch.no_grad():
            images = path.images(self.observation.patterns)[: len(self.observation.patterns)]
            return self._counted(_pooled(images, path.cells))

    @cached_property
    def masks(self) -> torch.Tensor:
        """``(U, T, H, W)`` transmittance for every frame of the scene, by sequence, as the model predicts it."""
        path = self.fit.fitter.model.path(self.fit.hypothesis)
        with torch.no_grad():
            shown = path.transmittance(self.observation.patterns, self.observation.sequences)
            return self._counted(_pooled(shown, path.cells))

    def _counted(self, field: torch.Tensor) -> torch.Tensor:
        """Return a field ``(.., H, W)`` without the border."""
        rows, columns = self.fit.fitter.split.window
        return field[..., rows, columns]


def _pooled(field: torch.Tensor, cells: int) -> torch.Tensor:
    """Return a field of q x q cells a pixel on whole pixels."""
    if cells == 1:
        return field
    flat = field.reshape(-1, 1, *field.shape[-2:])
    return torch.nn.functional.avg_pool2d(flat, cells).reshape(
        *field.shape[:-2], *(n // cells for n in field.shape[-2:])
    )


def predict_ahead(fit: Fit) -> Prediction:
    """Predict every capture with maps of pixels that are estimated from the captures before it only.

    Such a map has as many values as a capture has pixels: it follows the pixels that it was fitted to too closely, and
    differs from the others by its own error, the same in every capture. One step ahead neither is the case, and
    residuals are independent again (Dawid, "The prequential approach", 1984). The likelihood is taken as quadratic in
    the maps' values near the fitted ones, which it is not for black and for saturated pixels: captures of middle
    brightness come first. Maps of columns or rows, and the few hot pixels, are taken as known but for their error.

    Returns:
        mean and standard deviation ``(N, H, W)`` of every pixel.
    """
    pixel = {name: one for name, one in fit.maps.items() if one.kind == "pixel"}
    others = {name: one for name, one in fit.maps.items() if name not in pixel}
    prediction = with_map_uncertainty(fit.prediction, others)
    if not pixel:
        return prediction
    model, likelihood = fit.fitter.model, fit.evaluated.likelihood
    order = (fit.prediction.mean / model.observation.full_scale - 0.5).abs().mean((1, 2)).argsort()
    jacobian = torch.stack([one.jacobian for one in pixel.values()], -1)  # (N, H, W, K maps)
    values = torch.stack([model.windowed(fit.hypothesis.maps[name]) for name in pixel], -1)
    prior = torch.tensor([1 / max(one.std, 1e-9) ** 2 for one in pixel.values()]).diag()
    information = torch.zeros(*values.shape, len(pixel)) + prior  # (H, W, K, K)
    gradient = torch.zeros_like(values)
    mean, variance = prediction.mean.clone(), prediction.deviation.square()
    for n in order.tolist():
        covariance = torch.linalg.inv(information)
        correction = (covariance @ gradient[..., None])[..., 0] - values
        mean[n] += (jacobian[n] * correction).sum(-1)
        variance[n] += torch.einsum("hwk,hwkl,hwl->hw", jacobian[n], covariance, jacobian[n])
        weighted = jacobian[n] * likelihood.mean_information[n][..., None]
        information = information + weighted[..., None] * jacobian[n][..., None, :]
        gradient = (
            gradient
            + jacobian[n] * likelihood.mean_gradient[n][..., None]
            + weighted * (jacobian[n] * values).sum(-1, keepdim=True)
        )
    return replace(prediction, mean=mean, deviation=variance.sqrt())
