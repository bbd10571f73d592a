"""Does an estimated fixed-pattern map agree with the definition of its effect: independent and Gaussian, or smooth?"""

from __future__ import annotations

import math

import torch
from scipy.stats import chi2, norm
from scipy.stats import f as fisher

from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap
from sci_lightning.diagnosis.model.smooth_basis import SmoothBasis, beyond

MIN_VALUES = 16
"""Values below which only a trend can be told from chance, because the other distributions hold for many values."""
TREND_DEGREE = 3
"""Degree of the polynomial that a trend over rows or columns is taken for."""
MIN_KURTOSIS_VALUES = 200
"""Values from which the kurtosis is nearly normal."""
BLOCK_PIXELS = 8
"""Side of the square blocks whose sums are tested."""
MIN_FINE_DETAIL_SHARE = 0.02
"""Part of a smooth map's variance that finer detail must have to count: no lamp's ends where the polynomials do."""
MAX_STRUCTURED_SHARE = 0.1
"""Part of a pixel map's variance that may have a structure where targets and exposures have errors: the map holds what
the targets' share."""
RARE_SIGMA = 5.0
"""Standard deviations beyond which one in two million Gaussian values lies."""
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
"""Displacements (rows, columns) at which values are correlated with each other."""


def map_p_value(one: FixedPatternMap, dispersion: float = 1.0, in_laboratory: bool = False) -> float:
    """Return the p-value of the hypothesis that the values are independent and Gaussian, corrected for several tests.

    The values are maximum-likelihood estimates without the prior, divided by their standard deviation under the
    hypothesis, so that they are standard normal numbers. Hot pixels are few and may have any value; only their places
    are tested: they should not be neighbours more often than by chance. Of a smooth map it is tested whether the
    captures ask for detail just finer than such a map may have.

    Args:
        one: the map.
        dispersion: factor by which the variances of smooth detail are larger than noise makes them.
        in_laboratory: whether exposures or targets have errors; a little structure is no contradiction then.
    """
    if one.kind == "hot":
        return _hot_neighbours(one.values > 0)
    if one.smooth is not None:
        return _finer_than_smooth(one, one.smooth, dispersion)
    raw = one.values + one.likelihood_gradient / one.likelihood_information.clamp(min=1e-12)
    known = one.likelihood_information > 1e-3 * one.likelihood_information.median()
    spread = (one.std**2 + 1 / one.likelihood_information.clamp(min=1e-12)).sqrt()
    values = torch.where(known, raw / spread, 0.0)
    count = int(known.sum())
    lines = one.kind in ("row", "column")
    trend = [_trend(values.flatten(), known.flatten())] if lines else []
    if count < MIN_VALUES:
        return min([1.0, *trend])
    values = torch.where(known, (values - values[known].mean()) / values[known].std(), 0.0)
    if in_laboratory and not lines and _structured_share(values, known) < MAX_STRUCTURED_SHARE:
        return 1.0
    p_values = [_neighbours(values), _largest(values[known]), *trend]
    if not lines:
        p_values += [_sums(values.sum(0), known.sum(0)), _sums(values.sum(1), known.sum(1)), _blocks(values, known)]
    if count >= MIN_KURTOSIS_VALUES:
        kurtosis = float((values[known] ** 4).mean()) - 3
        p_values.append(2 * float(norm.sf(abs(kurtosis) / math.sqrt(24 / count))) if kurtosis > 0 else 1.0)
    return min(1.0, min(p_values) * len(p_values))


def has_mean(one: FixedPatternMap) -> bool:
    """Return whether rows or columns clearly share an offset, which is no noise of theirs."""
    values = one.values.flatten()
    if one.kind not in ("row", "column") or len(values) < MIN_VALUES:
        return False
    return abs(float(values.mean())) > RARE_SIGMA * float(values.std()) / math.sqrt(len(values))


def _neighbours(values: torch.Tensor) -> float:
    """Return the p-value of the correlations with all neighbours together."""
    squares, count = 0.0, 0
    for down, across in NEIGHBOURS:
        if values.shape[0] > down and values.shape[1] > abs(across):
            moved = values.roll((down, across), (0, 1)) * values
            moved = moved[down:, max(across, 0) : values.shape[1] + min(across, 0)]
            if moved.numel() >= MIN_VALUES:
                squares += float(moved.sum() ** 2 / (moved != 0).sum().clamp(min=1))
                count += 1
    return float(chi2.sf(squares, count)) if count else 1.0


def _structured_share(values: torch.Tensor, known: torch.Tensor) -> float:
    """Return the largest part of the variance that rows, columns or blocks have in common, or neighbours, or that the
    few values hold which a Gaussian does not have."""
    rows, columns = (_squares(values.sum(axis), known.sum(axis)) for axis in (1, 0))
    shared = [(squares - free) / float(known.sum()) for squares, free in (rows, columns, _block_squares(values, known))]
    alike = [float((values[:-1] * values[1:]).mean()), float((values[:, :-1] * values[:, 1:]).mean())]
    rare = float(values[values.abs() > RARE_SIGMA].square().sum() / known.sum())
    return max(*shared, *map(abs, alike), rare)


def _trend(values: torch.Tensor, known: torch.Tensor) -> float:
    """Return the p-value of a polynomial of degree ``TREND_DEGREE``, by Fisher's F, exact for few values."""
    left = int(known.sum()) - TREND_DEGREE - 1
    if left < 1:
        return 1.0
    place = torch.linspace(-1, 1, len(values), dtype=torch.float64)[known]
    basis = torch.linalg.qr(torch.stack([place**power for power in range(TREND_DEGREE + 1)], 1)).Q
    along = basis.T @ values[known].double()
    trend, total = float(along[1:].square().sum()), float((values[known] - basis[:, 0] * along[0]).square().sum())
    return float(fisher.sf(trend / TREND_DEGREE / max((total - trend) / left, 1e-30), TREND_DEGREE, left))


def _largest(values: torch.Tensor) -> float:
    """Return the p-value of the largest of so many values (Bonferroni)."""
    return min(1.0, 2 * values.numel() * float(norm.sf(float(values.abs().max()))))


def _sums(sums: torch.Tensor, counts: torch.Tensor) -> float:
    """Return the p-value of the sums over whole rows, columns or blocks."""
    return float(chi2.sf(*_squares(sums, counts)))


def _squares(sums: torch.Tensor, counts: torch.Tensor) -> tuple[float, int]:
    """Return the squares of sums over their counts, added up, and their degrees of freedom."""
    some = counts > 0
    return float((sums[some].square() / counts[some]).sum()), int(some.sum()) - 1


def _blocks(values: torch.Tensor, known: torch.Tensor) -> float:
    """Return the p-value of the sums over square blocks."""
    return float(chi2.sf(*_block_squares(values, known)))


def _block_squares(values: torch.Tensor, known: torch.Tensor) -> tuple[float, int]:
    """Return the same of the sums over square blocks."""
    pool = torch.nn.functional.avg_pool2d
    sums = pool(values[None, None], BLOCK_PIXELS, ceil_mode=True, divisor_override=1).flatten()
    counts = pool(known[None, None].to(values), BLOCK_PIXELS, ceil_mode=True, divisor_override=1).flatten()
    return _squares(sums, counts)


def _hot_neighbours(hot: torch.Tensor) -> float:
    """Return the p-value of the number of neighbouring pairs of hot pixels, which is Poisson distributed by chance."""
    count, pixels = int(hot.sum()), hot.numel()
    pairs = int((hot[1:] & hot[:-1]).sum() + (hot[:, 1:] & hot[:, :-1]).sum())
    expected = 2 * count**2 / pixels + 1e-9
    return float(chi2.cdf(2 * expected, 2 * pairs)) if pairs else 1.0


def _finer_than_smooth(one: FixedPatternMap, basis: SmoothBasis, dispersion: float) -> float:
    """Return the p-value of the detail that a smooth map leaves just beyond the finest that it may have."""
    if one.pixel_gradient is None or one.pixel_information is None or not len(one.values):
        return 1.0
    finer = beyond(*one.pixel_information.shape)
    if not len(finer):
        return 1.0
    weighted = finer * one.pixel_information.flatten().double()
    shared = weighted @ basis.functions.flatten(1).T  # the smooth functions answer to a change of the finer ones
    information = weighted @ finer.T - (shared / one.precision) @ shared.T
    gradient = finer @ one.pixel_gradient.flatten().double() - shared @ (one.gradient / one.precision)
    values, vectors = torch.linalg.eigh(information)
    known = values > 0.01 * values.max().clamp(min=1e-30)
    along = (vectors.T @ gradient)[known]
    statistic = float((along.square() / values[known]).sum()) / dispersion
    size = float((along / values[known]).square().sum() - (dispersion / values[known]).sum())
    smooth = float(torch.einsum("k,khw->hw", one.values, basis.seen).square().mean())  # beyond, it is extrapolated
    return float(chi2.sf(statistic, int(known.sum()))) if size > MIN_FINE_DETAIL_SHARE * smooth else 1.0
