"""Does the misfit depend on how bright a pixel is, and is there too much or too little light?"""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, Regression, judge
from sci_lightning.diagnosis.residual_tests.residuals import Residuals


def intensity(residuals: Residuals) -> Answer:
    """Test the mean residual of every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (residuals.by_level(values) for values in (residuals.scaled, residuals.prediction.mean))
    kept = count > 0
    count, mean, place = (values[kept] for values in (count, *(total / count for total in sums)))
    picture = Picture(
        "curve",
        mean,
        unit="mean residual (σ)",
        x=tuple(place.tolist()),
        axes=("predicted signal (DN)",),
        errors=count.rsqrt(),
    )
    return judge(mean * count.sqrt(), picture)


NAMES = ("own", "even", "in the dark")


def light(residuals: Residuals) -> Answer:
    """Regress the residual on the signal, its mean over the capture, and a constant: gain, glare, black level."""
    regression = Regression(len(NAMES))
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    for picture, weight, residual in zip(pictures, residuals.sensitivity, residuals.scaled, strict=True):
        regression.add(
            torch.stack((picture, picture.mean().expand_as(picture), torch.ones_like(picture))) * weight, residual
        )
    return regression.answer(NAMES, "light", "part of the light")
