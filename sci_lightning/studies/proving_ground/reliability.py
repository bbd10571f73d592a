"""Shares of cases with their confidence intervals, and reliability: how many of the names that were stated are true."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from statistics import mean

from sci_lightning.files.diagnosis_report import NamedEffect

NORMAL = 1.959964
"""Half the width of the interval that contains 95 % of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Proportion:
    """``count`` of ``total`` cases."""

    count: int
    total: int

    @classmethod
    def of(cls, answers: Iterable[bool]) -> Proportion:
        """Count the answers that are true."""
        listed = list(answers)
        return cls(sum(listed), len(listed))

    @property
    def share(self) -> float:
        """``count / total``, 0 to 1; NaN without cases."""
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the probability by Wilson's score (JASA 22, 1927); (0, 1) without cases."""
        if not self.total:
            return 0.0, 1.0
        z, n = NORMAL, self.total
        middle = (self.share + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * math.sqrt(self.share * (1 - self.share) / n + z**2 / (4 * n**2))
        return max(middle - half, 0.0), min(middle + half, 1.0)


EDGES = (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 0.999, 1.0)
"""Between which stated probabilities are counted together; what is less probable than its prior is not asked."""


@dataclass(frozen=True)
class Statement:
    """An effect is there with some probability, and it is or is not."""

    probability: float
    true: bool


@dataclass(frozen=True)
class Reliability:
    """Statements of about the same probability.

    Attributes:
        low: smallest probability.
        high: largest one.
        stated: their mean probability.
        true: how many are true.
    """

    low: float
    high: float
    stated: float
    true: Proportion


def statements(
    named: Iterable[NamedEffect], not_named: Mapping[str, float], true_names: Collection[str]
) -> list[Statement]:
    """Return what a diagnosis states: every name or class of names, every member of a class, and what it did not name.

    Args:
        named: effects of the report.
        not_named: probabilities of other effects, by name.
        true_names: what is hidden, or true as well.
    """
    stated = [Statement(probability, name in true_names) for name, probability in not_named.items()]
    for effect in named:
        if effect.probability is None:
            continue
        members = effect.shares or {effect.name: 1.0}
        stated.append(Statement(effect.probability, any(name in true_names for name in members)))
        if len(members) > 1:
            stated += [Statement(effect.probability * share, name in true_names) for name, share in members.items()]
    return stated


def reliability(stated: Iterable[Statement]) -> list[Reliability]:
    """Count the true ones among statements of about the same probability; ranges without any are left out."""
    stated, counted = list(stated), []
    for low, high in itertools.pairwise(EDGES):
        some = [one for one in stated if low <= one.probability < high or one.probability == high == EDGES[-1]]
        if some:
            true = Proportion.of(one.true for one in some)
            counted.append(Reliability(low, high, mean(one.probability for one in some), true))
    return counted
