"""What the model predicts of every pixel from those before it, where it estimates maps."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Prediction


def predict_ahead(fitter: Fitter, fit: Fit) -> Prediction:
    """Mean and deviation ``(N, H, W)`` that use of maps of pixels only what the captures before have told.

    Such a map has as many values as a capture has pixels: what it was fitted to, it follows too closely, and what it
    was not fitted to differs by the map's own error, the same in every capture. One step ahead neither is the case,
    and residuals are independent again (Dawid, "The prequential approach", 1984). The likelihood is taken as quadratic
    in the maps' values near the fitted ones, which it is not for the black and the saturated: captures of middle
    brightness come first. Maps of columns or rows, and the few hot pixels, are taken as known but for their error.
    """
    pixel = {name: chart for name, chart in fit.charts.items() if chart.kind == "pixel"}
    others = {name: chart for name, chart in fit.charts.items() if name not in pixel}
    prediction = fitter.uncertain(fit.prediction, others)
    if not pixel:
        return prediction
    score = fitter.score(fit.prediction)
    order = (fit.prediction.mean / fitter.model.observation.full_scale - 0.5).abs().mean((1, 2)).argsort()
    jacobian = torch.stack([chart.jacobian for chart in pixel.values()], -1)  # (N, H, W, K maps)
    values = torch.stack([fit.hypothesis.charts[name] for name in pixel], -1)
    prior = torch.tensor([1 / max(chart.std, 1e-9) ** 2 for chart in pixel.values()]).diag()
    information = torch.zeros(*values.shape, len(pixel)) + prior  # (H, W, K, K)
    pull = torch.zeros_like(values)
    mean, variance = prediction.mean.clone(), prediction.deviation.square()
    for n in order.tolist():
        covariance = torch.linalg.inv(information)
        told = (covariance @ pull[..., None])[..., 0] - values
        mean[n] += (jacobian[n] * told).sum(-1)
        variance[n] += torch.einsum("hwk,hwkl,hwl->hw", jacobian[n], covariance, jacobian[n])
        weighted = jacobian[n] * score.weight[n][..., None]
        information = information + weighted[..., None] * jacobian[n][..., None, :]
        pull = pull + jacobian[n] * score.slope[n][..., None] + weighted * (jacobian[n] * values).sum(-1, keepdim=True)
    return replace(prediction, mean=mean, deviation=variance.sqrt())
