"""Does the misfit depend on how bright a pixel is?"""

from __future__ import annotations

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge


def intensity(residuals: Residuals) -> Answer:
    """Mean residual of every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (residuals.by_level(each) for each in (residuals.scaled, residuals.prediction.mean))
    kept = count > 0
    count, mean, place = (each[kept] for each in (count, *(each / count for each in sums)))
    picture = Picture(
        "curve",
        mean,
        unit="mean residual (σ)",
        x=tuple(place.tolist()),
        axes=("predicted signal (DN)",),
        errors=count.rsqrt(),
    )
    return judge(mean * count.sqrt(), picture)
