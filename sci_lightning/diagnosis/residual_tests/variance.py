"""Is the noise as strong as predicted, at every level and everywhere?"""

from __future__ import annotations

from sci_lightning.diagnosis.residual_tests.position import PLACE, block_sums, extent
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import FEW, Residuals
from sci_lightning.diagnosis.residual_tests.significance import chi2_normal, judge


def variance_by_intensity(residuals: Residuals) -> Answer:
    """Variance of the residuals about their mean at every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (
        residuals.by_level(each) for each in (residuals.raw, residuals.raw.double().square(), residuals.prediction.mean)
    )
    kept = count > FEW
    count, mean, squares, place = (each[kept] for each in (count, *(each / count for each in sums)))
    freedom = count - 1
    total = count * (squares - mean.square())
    picture = Picture(
        "curve",
        total / freedom,
        unit="variance (1 = as predicted)",
        x=tuple(place.tolist()),
        axes=("predicted signal (DN)",),
        errors=(2 / freedom).sqrt(),
        middle=1.0,
    )
    return judge(chi2_normal(total, freedom), picture)


def variance_by_position(residuals: Residuals) -> Answer:
    """Variance of the residuals in square blocks of pixels, about the mean of each pixel over the captures."""
    count = len(residuals.raw)
    raw = residuals.raw.double()
    spread = (raw - raw.mean(0)).square().sum(0) if count > 1 else raw.square().sum(0)
    total, size = block_sums(spread)
    freedom = size * max(count - 1, 1)
    unit = "log10 of variance (0 = as predicted)"
    picture = Picture("map", (total / freedom).log10(), unit, axes=PLACE, extent=extent(raw))
    return judge(chi2_normal(total, freedom), picture)
