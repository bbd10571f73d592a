"""Does the misfit go with the brightness of a pixel, its place on the sensor, its noise, or its code?"""

from __future__ import annotations

import math

import torch
from scipy.stats import ncx2

from sci_lightning.diagnosis.fit.cluster_errors import map_dispersion
from sci_lightning.diagnosis.residual_tests.residual_test import (
    MIN_CHI2_FREEDOM,
    Answer,
    Picture,
    Regression,
    chi2_normal,
    test_scores,
)
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.search.map_test import map_p_value

BLOCKS_PER_SIDE = 16
"""Blocks along the longer side of the field at most: one is smaller than a region of a tenth of the side."""
MIN_BLOCK_PIXELS = 4
"""Pixels along the side of a block at least."""
RADIAL_RINGS = 16
"""Rings of equal area around the centre."""
MIN_SPREAD_SHARE = 0.1
"""Part of the prior's standard deviation that a map value's spread has at least when it is drawn."""
HISTOGRAM_BINS = 40
"""Bins of equal probability of the residuals."""
NEGLIGIBLE_SQUARED_ERROR = 1e-4
"""Squared relative error of the bins' probabilities that is allowed: photon counts are not quite normal."""
NEIGHBOUR_CODES = 64
"""Codes to either side within which one that occurs must lie, for a code between to be missed."""
MODEL_DRAWS = 4
"""Times that the captures are drawn from the model, to see how often it gives a code."""
PLACE = ("column (pixel)", "row (pixel)")
"""Labels of the axes of a map of the sensor."""


def intensity(residuals: Residuals) -> Answer:
    """Test the mean residual of every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (residuals.by_level(values) for values in (residuals.scaled, residuals.prediction.mean))
    kept = count > 0
    count, mean, place = (values[kept] for values in (count, *(total / count for total in sums)))
    return _mean_answer(mean, count, place, "predicted signal (DN)")


def light(residuals: Residuals) -> Answer:
    """Regress the residual on the signal, its mean over the capture, and a constant: gain, glare, black level."""
    names = ("own", "even", "in the dark")
    regression = Regression(len(names))
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    for picture, weight, residual in zip(pictures, residuals.sensitivity, residuals.scaled, strict=True):
        regression.add(
            torch.stack((picture, picture.mean().expand_as(picture), torch.ones_like(picture))) * weight, residual
        )
    return regression.answer(names, "light", "part of the light")


def blocks(residuals: Residuals) -> Answer:
    """Test the mean residual of square blocks of pixels."""
    total, size = _block_sums(residuals.scaled.sum(0))
    scores = total / (size * len(residuals.raw)).sqrt()
    return test_scores(scores, Picture("map", scores, axes=PLACE, extent=extent(residuals)))


def rows(residuals: Residuals) -> Answer:
    """Test the mean residual of every row."""
    return _line_answer(residuals, (0, 2), "row (pixel)", residuals.origin[0])


def columns(residuals: Residuals) -> Answer:
    """Test the mean residual of every column."""
    return _line_answer(residuals, (0, 1), "column (pixel)", residuals.origin[1])


def radius(residuals: Residuals) -> Answer:
    """Test the mean residual of rings around the image centre, of equal area."""
    count, height, width = residuals.raw.shape
    (top, left), (whole_height, whole_width) = residuals.origin, residuals.field
    y = torch.arange(top, top + height) - (whole_height - 1) / 2
    x = torch.arange(left, left + width) - (whole_width - 1) / 2
    distance = torch.hypot(y[:, None], x[None])
    ring = (distance.flatten().argsort().argsort() * RADIAL_RINGS) // distance.numel()
    size = torch.bincount(ring, minlength=RADIAL_RINGS).double()
    total = torch.bincount(ring, residuals.scaled.sum(0).flatten().double(), minlength=RADIAL_RINGS)
    place = torch.bincount(ring, distance.flatten().double(), minlength=RADIAL_RINGS) / size
    return _mean_answer(total / (size * count), size * count, place, "distance from the image centre (pixel)")


def pixels(residuals: Residuals) -> Answer:
    """Test the mean residual of every single pixel."""
    scores = residuals.scaled.sum(0) / len(residuals.raw) ** 0.5
    return test_scores(scores, Picture("map", scores, axes=PLACE, extent=extent(residuals)))


def _block_sums(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the sum of a ``(H, W)`` field over every block, ``(h, w)`` float64, and the number of its pixels."""
    height, width = field.shape
    side = max(MIN_BLOCK_PIXELS, -(-max(height, width) // BLOCKS_PER_SIDE))
    down, across = -(-height // side), -(-width // side)
    index = (torch.arange(height) // side)[:, None] * across + (torch.arange(width) // side)[None]
    total = torch.bincount(index.flatten(), field.flatten().double(), minlength=down * across)
    size = torch.bincount(index.flatten(), minlength=down * across).double()
    return total.reshape(down, across), size.reshape(down, across)


def extent(residuals: Residuals) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top, in pixels of the field, of a map of the residuals."""
    (top, left), (height, width) = residuals.origin, residuals.raw.shape[-2:]
    return left - 0.5, left + width - 0.5, top + height - 0.5, top - 0.5


def _line_answer(residuals: Residuals, summed: tuple[int, int], axis: str, first: int) -> Answer:
    """Test the mean residual along the one dimension that is not ``summed``."""
    total = residuals.scaled.sum(summed)
    count = torch.full_like(total, residuals.raw.numel() // len(total))
    return _mean_answer(total / count, count, torch.arange(first, first + len(total)).float(), axis)


def _mean_answer(mean: torch.Tensor, count: torch.Tensor, place: torch.Tensor, axis: str) -> Answer:
    """Test the mean residuals ``(P,)`` of so many pixels each, which are drawn along an axis."""
    picture = Picture(
        "curve", mean, unit="mean residual (σ)", x=tuple(place.tolist()), axes=(axis,), errors=count.rsqrt()
    )
    return test_scores(mean * count.sqrt(), picture)


def estimated_map(residuals: Residuals, name: str) -> Answer:
    """Test an estimated map, see :func:`~sci_lightning.diagnosis.search.map_test.map_p_value`.

    A map absorbs whatever stays at its place: dust or a dead line too, whose values are not independent.
    """
    one = residuals.fit.maps[name]
    values = residuals.fit.hypothesis.maps[name].double()
    if one.kind != "smooth":
        values = residuals.fit.fitter.model.windowed(values)
        scores = values / (one.std**2 - one.variance).clamp(min=(MIN_SPREAD_SHARE * one.std) ** 2).sqrt()
    if one.kind == "smooth":
        picture = Picture("map", values, "part of the light", axes=PLACE)
    elif one.kind == "hot":
        picture = Picture("map", values, "part of full scale", axes=PLACE)
    elif one.kind == "pixel":
        picture = Picture("map", scores, axes=PLACE)
    else:
        place = tuple(map(float, range(scores.numel())))
        picture = Picture("curve", scores.flatten(), x=place, axes=(PLACE[one.kind == "row"],))
    p_value = map_p_value(one, map_dispersion(residuals.fit, one)[0], residuals.fit.in_laboratory)
    nats = -math.log(max(p_value, 1e-300))
    return Answer(nats, p_value, nats, picture)


def variance_by_intensity(residuals: Residuals) -> Answer:
    """Test the variance of the residuals about their mean at every level of predicted signal."""
    count = residuals.by_level(None)
    sums = (
        residuals.by_level(values)
        for values in (residuals.raw, residuals.raw.double().square(), residuals.prediction.mean)
    )
    kept = count > MIN_CHI2_FREEDOM
    count, mean, squares, place = (values[kept] for values in (count, *(total / count for total in sums)))
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
    return test_scores(chi2_normal(total, freedom), picture)


def variance_by_position(residuals: Residuals) -> Answer:
    """Test the variance of the residuals in square blocks of pixels, about the mean of a pixel over the captures."""
    count = len(residuals.raw)
    raw = residuals.raw.double()
    spread = (raw - raw.mean(0)).square().sum(0) if count > 1 else raw.square().sum(0)
    total, size = _block_sums(spread)
    freedom = size * max(count - 1, 1)
    unit = "log10 of variance (0 = as predicted)"
    picture = Picture("map", (total / freedom).log10(), unit, axes=PLACE, extent=extent(residuals))
    return test_scores(chi2_normal(total, freedom), picture)


def distribution(residuals: Residuals) -> Answer:
    """Compare the histogram of the residuals' absolute values with the standard normal, by Pearson's chi2.

    Signs are left out: a wrong mean shows in other tests, and the skewness of few photons is no fault. A negligible
    difference is allowed.
    """
    counts, expected = _histogram(residuals.raw)
    sizes = counts[: HISTOGRAM_BINS // 2].flip(0) + counts[HISTOGRAM_BINS // 2 :]
    statistic = float((sizes - 2 * expected).square().sum() / (2 * expected))
    freedom = HISTOGRAM_BINS // 2 - 1
    middle = torch.special.ndtri((torch.arange(HISTOGRAM_BINS, dtype=torch.float64) + 0.5) / HISTOGRAM_BINS)
    picture = Picture(
        "curve",
        counts / expected,
        unit="count (1 = as expected)",
        x=tuple(middle.tolist()),
        axes=("residual (σ)",),
        errors=torch.full((HISTOGRAM_BINS,), expected**-0.5),
        middle=1.0,
    )
    count = residuals.raw.numel()
    nats = max(0.0, statistic - freedom) / 2
    return Answer(statistic, float(ncx2.sf(statistic, freedom, NEGLIGIBLE_SQUARED_ERROR * count)), nats, picture)


def _histogram(raw: torch.Tensor) -> tuple[torch.Tensor, float]:
    """Return the number of residuals in every bin, and the number that is expected in any."""
    edges = torch.special.ndtri(torch.arange(1, HISTOGRAM_BINS, dtype=torch.float64) / HISTOGRAM_BINS).float()
    counts = torch.bincount(torch.bucketize(raw.flatten(), edges), minlength=HISTOGRAM_BINS)
    return counts.double(), raw.numel() / HISTOGRAM_BINS


def codes(residuals: Residuals) -> Answer:
    """Look for codes that never occur in the raw captures though the model gives them and codes to either side do.

    A code is missed as often as the model gives it or, if that is less, half as often as the rarer of its nearest
    neighbours occurs: a wrong mean alone leaves no code missing. How often a code occurs is Poisson-distributed.
    """
    observation = residuals.observation
    full = observation.full_scale
    counts = torch.bincount(observation.dn.flatten().long(), minlength=full + 1).double()
    missing = counts == 0
    index = torch.arange(full + 1)
    below = torch.where(missing, -NEIGHBOUR_CODES - 1, index).cummax(0).values
    above = torch.where(missing, full + NEIGHBOUR_CODES + 1, index).flip(0).cummin(0).values.flip(0)
    between = (missing & (index - below <= NEIGHBOUR_CODES) & (above - index <= NEIGHBOUR_CODES)).nonzero()[:, 0]
    neighbours = torch.minimum(counts[below[between]], counts[above[between]]) / 2
    missed = torch.minimum(_drawn(residuals)[between], neighbours)
    statistic = float(missed.max()) if len(missed) else 0.0
    shown = int((~missing).nonzero().max()) + 1
    picture = Picture(
        "curve", counts[:shown], unit="pixels", x=tuple(float(n) for n in range(shown)), axes=("code (DN)",)
    )
    return Answer(statistic, min(1.0, (full + 1) * math.exp(-min(statistic, 600.0))), statistic, picture)


def _drawn(residuals: Residuals) -> torch.Tensor:
    """Return how many pixels of every code the model gives with its converter."""
    full, prediction = residuals.observation.full_scale, residuals.prediction
    random = torch.Generator().manual_seed(residuals.seed)
    step = full / (2**prediction.bits - 1)
    count = torch.zeros(full + 1, dtype=torch.float64)
    for _ in range(MODEL_DRAWS):
        noise = torch.randn(prediction.mean.shape, generator=random)
        signal = (prediction.mean + prediction.deviation * noise).clamp(0, full)
        drawn = ((signal / step).round() * step).round().long()
        count += torch.bincount(drawn.flatten(), minlength=full + 1)
    return count / MODEL_DRAWS
