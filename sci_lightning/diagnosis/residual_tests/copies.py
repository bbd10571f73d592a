"""Does the misfit look like the picture itself, but elsewhere?"""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge

REACH = 32
"""Pixels of displacement that are drawn; all are tested."""


def copies(residuals: Residuals) -> Answer:
    """Residual correlated with the predicted picture over all displacements: reflections, tails, a second image.

    What follows the picture itself is taken out first: it is a matter of gain, not of place.
    """
    height, width = residuals.observation.size
    total, squares = torch.zeros(height, width), 0.0
    for mean, weight, residual in zip(residuals.prediction.mean, residuals.sensitivity, residuals.scaled, strict=True):
        picture = mean - mean.mean()
        size = float(picture.square().sum())
        if size == 0 or not weight.any():
            continue
        picture = picture * weight.mean()
        left = residual - residual.mean()
        left = left - picture * (left * picture).sum() / picture.square().sum()
        total += torch.fft.irfft2(torch.fft.rfft2(left) * torch.fft.rfft2(picture).conj(), s=(height, width))
        squares += float(picture.square().sum())
    scores = torch.fft.fftshift(total / max(squares, 1e-30) ** 0.5)
    top, left_edge = height // 2, width // 2
    rows = slice(max(0, top - REACH), top + REACH + 1)
    columns = slice(max(0, left_edge - REACH), left_edge + REACH + 1)
    shown = scores[rows, columns]
    up, aside = top - rows.start, left_edge - columns.start
    extent = (-aside - 0.5, shown.shape[1] - aside - 0.5, shown.shape[0] - up - 0.5, -up - 0.5)
    image = Picture("map", shown, axes=("displaced to the right (pixel)", "displaced down (pixel)"), extent=extent)
    return judge(scores, image, dependent=True)
