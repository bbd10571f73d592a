"""Is there too much light, or too little: of a pixel's own, spread over the picture, or in the dark?"""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.regression import Regression
from sci_lightning.diagnosis.residual_tests.residual_test import Answer
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

NAMES = ("own", "even", "in the dark")


def light(residuals: Residuals) -> Answer:
    """Residual against the predicted signal, its mean over the capture, and a constant: gain, glare, black level."""
    found = Regression(len(NAMES))
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    for picture, weight, residual in zip(pictures, residuals.sensitivity, residuals.scaled, strict=True):
        found.add(
            torch.stack((picture, picture.mean().expand_as(picture), torch.ones_like(picture))) * weight, residual
        )
    return found.answer(NAMES, "light", "part of the light")
