"""The residuals that are asked, and what the model says about the pixels they come from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Prediction
from sci_lightning.diagnosis.model.likelihood import quantile_residuals
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.residual_tests.ahead import predict_ahead

FAR = 6.0
"""Standard deviations; what lies further out counts as this far, so that a few pixels do not hide all the others."""
FEW = 30
"""Pixels from which the variance of a level is found; one of fewer is taken to be like the others."""
LEAST = 1e-4
"""Variance of residuals that is told from none."""
ROUNDING = 1e-4
"""Part of full scale by which signals that are equal may differ in the computer."""
LEVELS = 32
"""Groups of pixels of about equal predicted signal."""
BRIGHTEST = (0.985, 0.995, 0.999)
"""Where the brightest of them is divided further: saturation begins there."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of a fit.

    Attributes:
        fitter: of the captures.
        fit: the model that is asked.
        raw: ``(N, H, W)`` randomised quantile residuals, standard normal when the model is right.
        prediction: mean and deviation, see :func:`predict_ahead`.
        seed: of what is random.
    """

    fitter: Fitter
    fit: Fit
    raw: torch.Tensor
    prediction: Prediction
    seed: int

    @staticmethod
    def of(fitter: Fitter, fit: Fit, seed: int) -> Residuals:
        """Of a fit, all pixels: those that were fitted too."""
        prediction = predict_ahead(fitter, fit)
        random = torch.Generator().manual_seed(seed)
        intervals = fitter.intervals(prediction.bits)
        raw = quantile_residuals(intervals, prediction.mean, prediction.deviation, random, prediction.ceiling)
        return Residuals(fitter, fit, raw, prediction, seed)

    @property
    def seen(self) -> Observation:
        """The captures."""
        return self.fitter.model.observation

    @cached_property
    def level(self) -> torch.Tensor:
        """``(N, H, W)`` which group of predicted signal a pixel is in: of equal size, smaller at the bright end."""
        mean = self.prediction.mean
        sample = mean.flatten()[:: max(1, mean.numel() // 100_000)].sort().values
        shares = torch.cat((torch.arange(1, LEVELS) / LEVELS, torch.tensor(BRIGHTEST)))
        edges = sample[(shares * (len(sample) - 1)).round().long()].unique()
        edges = edges + ROUNDING * self.seen.full_scale  # many pixels of even scenes lie right at an edge
        return torch.bucketize(mean, edges, right=True)

    @cached_property
    def scale(self) -> torch.Tensor:
        """``(N, H, W)`` what residuals are multiplied with for questions about the mean.

        Every level of signal and every capture then has the variance 1 as it is found, so that noise that is stated
        wrongly is not taken for structure.
        """
        cut = self.cut
        count, total, squares = (self.by_level(each) for each in (None, cut, cut.square()))
        common = cut.square().mean()
        variance = (squares - total.square() / count.clamp(min=1) + FEW * common) / (count.clamp(min=1) - 1 + FEW)
        scale = variance.clamp(min=LEAST).rsqrt().float()[self.level]
        return scale * (cut * scale).square().mean((1, 2), keepdim=True).clamp(min=LEAST).rsqrt()

    @property
    def cut(self) -> torch.Tensor:
        """``(N, H, W)`` residuals, those beyond ``FAR`` put there."""
        return self.raw.clamp(-FAR, FAR)

    @cached_property
    def scaled(self) -> torch.Tensor:
        """``(N, H, W)`` residuals for questions about the mean: cut and scaled."""
        return self.cut * self.scale

    def by_level(self, values: torch.Tensor | None) -> torch.Tensor:
        """Sum over the pixels of each level, or their number: ``(levels,)`` float64."""
        weights = None if values is None else values.flatten().double()
        return torch.bincount(self.level.flatten(), weights, minlength=int(self.level.max()) + 1).double()

    @cached_property
    def sensitivity(self) -> torch.Tensor:
        """``(N, H, W)`` what :attr:`scaled` grows by with the signal, which is 1 at full scale."""
        mean, full = self.prediction.mean, self.seen.full_scale
        deviation = (self.prediction.deviation.square() + 1 / 12).sqrt()
        steep = full / deviation * self.scale
        return torch.where((mean > 0) & (mean < full), steep, 0.0)

    @cached_property
    def images(self) -> torch.Tensor:
        """``(P, H, W)`` the patterns as the model believes they are imaged on the pixels."""
        path = self.fitter.model.path(self.fit.hypothesis)
        with torch.no_grad():
            return _pooled(path.images(self.seen.patterns), path.cells)

    @cached_property
    def masks(self) -> torch.Tensor:
        """``(U, T, H, W)`` what each frame of the scene is multiplied with, by sequence, as the model believes."""
        path = self.fitter.model.path(self.fit.hypothesis)
        with torch.no_grad():
            return _pooled(path.transmittance(self.seen.patterns, self.seen.sequences), path.cells)


def _pooled(field: torch.Tensor, cells: int) -> torch.Tensor:
    if cells == 1:
        return field
    flat = field.reshape(-1, 1, *field.shape[-2:])
    return torch.nn.functional.avg_pool2d(flat, cells).reshape(
        *field.shape[:-2], *(n // cells for n in field.shape[-2:])
    )
