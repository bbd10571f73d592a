"""A share of cases with its confidence interval."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

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
