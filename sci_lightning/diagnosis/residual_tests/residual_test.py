"""A question to the residuals, and its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import torch

from sci_lightning.diagnosis.search_settings import SearchSettings

SIGNIFICANT = SearchSettings.significance
"""Corrected p-value below which a test reports a structure, unless the settings say otherwise."""

About: TypeAlias = Literal["mean", "variance", "converter", "map"]


@dataclass(frozen=True)
class Picture:
    """What a test saw, fit to be drawn.

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
    """What a test finds before it is known how many questions were asked.

    Attributes:
        statistic: the larger, the less it can be chance.
        p_value: probability of such a statistic, or a larger one, when the model is right.
        nats: log-likelihood that a model of this structure would gain, about; what chance gives taken off.
        picture: what there is to be observation.
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
        corrected: p-value for having asked all the questions, by Holm.
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
        """Whether it is more than chance."""
        return self.corrected < self.significance

    def describe(self) -> dict[str, Any]:
        """For the report."""
        named = ("name", "about", "question", "statistic", "p_value", "corrected", "nats", "significant")
        return {name: getattr(self, name) for name in named}


def corrected(tests: Sequence[ResidualTest]) -> list[ResidualTest]:
    """The tests with their p-values corrected for how many there are.

    Holm, "A simple sequentially rejective multiple test procedure" (1979): holds however the tests depend on each
    other.
    """
    largest = 0.0
    found = dict.fromkeys(range(len(tests)), 1.0)
    for rank, index in enumerate(sorted(found, key=lambda index: tests[index].p_value)):
        largest = max(largest, min(1.0, (len(tests) - rank) * tests[index].p_value))
        found[index] = largest
    return [replace(test, corrected=found[index]) for index, test in enumerate(tests)]
