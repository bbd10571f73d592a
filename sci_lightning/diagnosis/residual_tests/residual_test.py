"""A residual test and its result, and how p-values are computed for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import torch
from scipy.stats import chi2, norm

from sci_lightning.diagnosis.search_settings import SearchSettings

About: TypeAlias = Literal["mean", "variance", "converter", "map"]


@dataclass(frozen=True)
class Picture:
    """What a test found, to be drawn.

    Attributes:
        kind: ``map`` (values ``(h, w)``), ``curve`` or ``bars`` (values ``(n,)``).
        values: in standard errors, unless ``unit`` says otherwise.
        unit: of the values, for the colour bar or the upright axis.
        x: places of a curve's points, labels of the bars; of a map: what its columns are.
        axes: labels of the horizontal and the upright axis of a map, of the horizontal one otherwise.
        errors: ``(n,)`` standard errors of a curve's or of the bars' values; None where the values are in these.
        extent: left, right, bottom, top of a map in the units of its axes; None for numbers of cells.
        middle: value of the unremarkable, from which colours go two ways.
    """

    kind: Literal["map", "curve", "bars"]
    values: torch.Tensor
    unit: str = "standard errors"
    x: tuple[float, ...] | tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    errors: torch.Tensor | None = None
    extent: tuple[float, float, float, float] | None = None
    middle: float = 0.0


@dataclass(frozen=True)
class Answer:
    """What a test finds before it is known how many tests there are.

    Attributes:
        statistic: larger values are less likely by chance.
        p_value: probability of such a statistic, or a larger one, when the model is right.
        nats: log-likelihood that a model of this structure would gain, about; what chance gives taken off.
        picture: the picture that shows this answer.
    """

    statistic: float
    p_value: float
    nats: float
    picture: Picture


@dataclass(frozen=True)
class ResidualTest:
    """A question with its answer.

    Attributes:
        name: short, as in ``rows``.
        about: ``mean`` or ``variance`` of the residuals, the ``converter``'s codes, or an estimated ``map``. Noise can
            explain what is found about the variance, and nothing else.
        question: in plain words.
        statistic, p_value, nats, picture: see :class:`Answer`.
        corrected: p-value, corrected for the number of tests by Holm.
        significance: corrected p-value below which the test reports a structure.
    """

    name: str
    about: About
    question: str
    statistic: float
    p_value: float
    nats: float
    corrected: float
    picture: Picture
    significance: float = SearchSettings.significance

    @property
    def significant(self) -> bool:
        """Whether the test finds more than chance."""
        return self.corrected < self.significance

    def describe(self) -> dict[str, Any]:
        """Return the test as it stands in ``report.json``."""
        named = ("name", "about", "question", "statistic", "p_value", "corrected", "nats", "significant")
        return {name: getattr(self, name) for name in named}


def corrected(tests: Sequence[ResidualTest]) -> list[ResidualTest]:
    """Return the tests with p-values corrected for their number.

    Holm, "A simple sequentially rejective multiple test procedure" (1979): holds however the tests depend on each
    other.
    """
    largest = 0.0
    adjusted = dict.fromkeys(range(len(tests)), 1.0)
    for rank, index in enumerate(sorted(adjusted, key=lambda index: tests[index].p_value)):
        largest = max(largest, min(1.0, (len(tests) - rank) * tests[index].p_value))
        adjusted[index] = largest
    return [replace(test, corrected=adjusted[index]) for index, test in enumerate(tests)]


def test_scores(scores: torch.Tensor, picture: Picture, *, dependent: bool = False) -> Answer:
    """Test scores that are standard normal when the model is right.

    Structure may be spread over all of them, which their sum of squares shows, or be in a single one, which the
    largest shows: both are tested, and the smaller p-value counts, times two (Bonferroni).

    Args:
        scores: any shape.
        picture: of them.
        dependent: whether they may depend on each other; then only the largest is tested (Bonferroni).
    """
    scores = scores[scores.isfinite()].double().flatten()
    if not len(scores):
        return Answer(0.0, 1.0, 0.0, picture)
    largest = float(scores.abs().max())
    alone = min(1.0, 2 * float(norm.sf(largest)) * len(scores))
    if dependent:
        return Answer(largest, alone, max(0.0, largest**2 - 1) / 2, picture)
    total = float(scores.square().sum())
    nats = max(0.0, total - len(scores)) / 2
    return Answer(total, min(1.0, 2 * min(alone, float(chi2.sf(total, len(scores))))), nats, picture)


MIN_CHI2_FREEDOM = 30
"""Degrees of freedom from which :func:`chi2_normal` is exact to 1e-3 of a standard deviation."""


def chi2_normal(total: torch.Tensor, freedom: torch.Tensor) -> torch.Tensor:
    """Return standard normal scores of chi2-distributed sums; positive where a sum is too large.

    Source: Wilson and Hilferty's cube root, PNAS 17, 684 (1931).
    """
    spread = 2 / (9 * freedom)
    return ((total / freedom).pow(1 / 3) - (1 - spread)) / spread.sqrt()


NEGLIGIBLE_EIGENVALUE = 1e-6
"""Part of the largest eigenvalue below which a combination of changes counts as none."""


class Regression:
    """Sums of a regression on k changes, over captures that are added one by one.

    The scores' variance is estimated from the squared products themselves (White, "A heteroskedasticity-consistent
    covariance matrix estimator", 1980), so that a misfit of another kind at the same pixels is not taken for this one.

    Args:
        changes: k.
    """

    def __init__(self, changes: int) -> None:
        self.total = torch.zeros(changes, dtype=torch.float64)
        self.covariance = torch.zeros(changes, changes, dtype=torch.float64)
        self.weight = torch.zeros(changes, changes, dtype=torch.float64)

    def add(self, changes: torch.Tensor, residual: torch.Tensor) -> None:
        """Add one capture: changes of its residuals ``(k, H, W)``, and the residuals ``(H, W)``."""
        flat = changes.flatten(1)
        product = flat * residual.flatten()
        self.total += product.sum(1, dtype=torch.float64)
        self.covariance += (product @ product.T).double()
        self.weight += (flat @ flat.T).double()

    def centred(self) -> Regression:
        """Return the regression without what all changes have in common."""
        common = self.weight.sum(1)
        project = torch.eye(len(common), dtype=torch.float64) - common[:, None] / common.sum().clamp(min=1e-30)
        centred = Regression(len(common))
        centred.total = project @ self.total
        centred.covariance = project @ self.covariance @ project.T
        centred.weight = project @ self.weight @ project.T
        return centred

    def answer(self, names: tuple[str, ...], axis: str, unit: str) -> Answer:
        """Return the coefficients that fit best, all k at once, and test whether they differ from 0."""
        inverse = torch.linalg.pinv(self.weight, rtol=NEGLIGIBLE_EIGENVALUE, hermitian=True)
        errors = (inverse @ self.covariance @ inverse).diagonal().clamp(min=0).sqrt()
        values, vectors = torch.linalg.eigh(self.covariance)
        kept = values > NEGLIGIBLE_EIGENVALUE * values.max().clamp(min=1e-30)
        scores = (vectors.T @ self.total)[kept] / values[kept].sqrt()
        return test_scores(scores, Picture("bars", inverse @ self.total, unit, names, (axis,), errors))
