"""What the model predicts of every pixel from those before it, where it estimates maps."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.camera_model import Prediction
from sci_lightning.diagnosis.fit import Fit, Fitter


def predict_ahead(fitter: Fitter, fit: Fit) -> Prediction:
    """Mean and deviation ``(N, H, W)`` that use of a map of pixels only what the captures before have told.

    Such a map has as many values as a capture has pixels: what it was fitted to, it follows too closely, and what it
    was not fitted to differs by the map's own error, the same in every capture. One step ahead neither is the case,
    and residuals are independent again (Dawid, "The prequential approach", 1984). The likelihood is taken as quadratic
    in the map's values near the fitted ones, which it is not for the black and the saturated: captures of middle
    brightness come first. Maps of columns or rows, and the few hot pixels, are taken as known but for their error.
    """
    score = fitter.score(fit.prediction)
    prediction = fitter.uncertain(
        fit.prediction, {name: chart for name, chart in fit.charts.items() if chart.kind != "pixel"}
    )
    mean, variance = prediction.mean, prediction.deviation.square()
    order = (fit.prediction.mean / fitter.model.observation.full_scale - 0.5).abs().mean((1, 2)).argsort()
    for name, chart in fit.charts.items():
        if chart.kind == "pixel":
            values = fit.hypothesis.charts[name]
            weight = score.weight * chart.jacobian.square()
            pull = score.slope * chart.jacobian + weight * values
            known = _before(weight, order) + 1 / max(chart.std, 1e-9) ** 2
            mean = mean + chart.jacobian * (_before(pull, order) / known - values)
            variance = variance + chart.jacobian.square() / known
    return Prediction(mean, variance.sqrt(), prediction.bits)


def _before(field: torch.Tensor, order: torch.Tensor) -> torch.Tensor:
    """Of ``(N, H, W)`` the sum over the captures that come before in this order."""
    turned = field[order]
    return torch.empty_like(field).index_copy_(0, order, turned.cumsum(0) - turned)
