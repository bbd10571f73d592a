"""Verdicts on claims: a difference of trainings, its confidence interval, and what it decides.

A claim compares rows of the tables: it says that a weighted sum of their scores lies above a threshold (that A less B
is above 0, for instance). Scores vary for two reasons. Scenes differ, and so does what one row has ahead of another
from scene to scene; the rows are tested on the same scenes, so the difference is taken scene by scene. Trainings
differ as well: another seed gives other first weights, another random mask and other clips. With S scenes and K_i
seeds of row i,

    d_s = sum_i w_i mean_k score_i[k, s]                mean = mean_s d_s
    variance of the mean = var_s(d_s) / S + sum_i v_i w_i^2 / K_i

The first term is the paired t interval over the scenes; d_s has the interaction of seed and scene in it. v_i, the
variance of a row's mean score from seed to seed, is pooled over the rows of the same setting that were trained with
more than one seed: two or three seeds of one row alone would say next to nothing about it. Rows that were tested
through another encoder than they were trained with are pooled by themselves, because their scores vary several times
as much; so are trainings that made other numbers of steps, because the processor varies there and not the seed. The
degrees of freedom are combined after Welch and Satterthwaite, and the interval is that of Student's t.

That interval says what to expect of *other scenes*. The paper's claims are read off means over six scenes, and whether
those means would come out the same way in another training is a narrower question, which more seeds can decide. Its
interval has the second term alone: the scenes are held fixed.

Seeds are added where a comparison is undecided, so that a verdict is looked at several times, and each look is another
chance to decide falsely. The plan of looks therefore stands in ``paper_figures.yaml`` before the first one: of L looks,
each has an interval of confidence 1 - (1 - c) / L, and by Bonferroni's inequality all of them hold together with
probability c at least, whenever one stops and however the looks depend on each other.

Why not a hierarchical bootstrap: with six scenes and three seeds, resampling covers much less than it promises (the
percentile interval of six values is too narrow by a quarter), and a row of one seed has nothing to resample. The
interval over other scenes errs on the wide side: the interaction counts in both terms. Both intervals count seeds of
two rows as independent, although rows of one seed share clips and first weights, and take the seeds of all pooled rows
to vary alike. tests/studies/tables/test_verdict.py measures the coverage on simulated scores.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

CONFIDENCE = 0.95
"""Confidence of all looks at a comparison together."""
ENOUGH_LEARNED = 3.0
"""How much better than the mean measurement, in dB, a training must be for its row to decide anything."""

Scores = Sequence[Mapping[str, float]]
"""A metric's score by scene, one mapping for each seed."""


@dataclass(frozen=True)
class SeedSpread:
    """How much a row's mean score varies from seed to seed: a pooled variance and its degrees of freedom."""

    variance: float
    freedom: int


@dataclass(frozen=True)
class Interval:
    """A mean difference and its confidence interval; without bounds where the spread of the seeds is unknown."""

    mean: float
    low: float = -math.inf
    high: float = math.inf

    def verdict(self, threshold: float = 0.0, paper: float | None = None) -> str:
        """Return ``reproduced`` above the threshold, ``contradicted`` below it, ``undecided`` around it.

        Args:
            threshold: of the claim.
            paper: the paper's difference. Above the threshold, an interval that does not hold it has the sign of the
                claim and not its size: ``sign only``.
        """
        if self.low > threshold:
            return "reproduced" if paper is None or self.low <= paper <= self.high else "sign only"
        return "contradicted" if self.high < threshold else "undecided"


def seed_spread(rows: Iterable[Scores]) -> SeedSpread | None:
    """Return the variance of the rows' mean scores over the scenes from seed to seed, pooled over the rows.

    Args:
        rows: scores of rows of one setting; those of a single seed say nothing and are left out.

    Returns:
        None if no row has more than one seed.
    """
    groups = [[float(np.mean(list(seed.values()))) for seed in row] for row in rows if len(row) > 1]
    freedom = sum(len(group) - 1 for group in groups)
    if not freedom:
        return None
    return SeedSpread(sum(float(np.var(group)) * len(group) for group in groups) / freedom, freedom)


def interval(
    rows: Sequence[tuple[float, Scores, SeedSpread | None]],
    confidence: float = CONFIDENCE,
    *,
    same_scenes: bool = False,
    looks: int = 1,
) -> Interval:
    """Return the weighted sum of rows' scores, scene by scene, and its confidence interval.

    Args:
        rows: weights (1 for what is ahead, -1 for what is behind), scores of the same scenes, and the spread of the
            seeds of rows like this one, see :func:`seed_spread`.
        confidence: of the intervals of all looks together.
        looks: how often the comparison is looked at, as planned before the first look.
        same_scenes: hold the scenes fixed: the interval is for other trainings, tested on these very scenes.
    """
    scenes = sorted(set.intersection(*(set(seed) for _, row, _ in rows for seed in row)))
    differences = sum(
        weight * np.mean([[seed[scene] for scene in scenes] for seed in row], axis=0) for weight, row, _ in rows
    )
    mean = float(np.mean(differences))
    of_seeds: dict[SeedSpread, float] = {}
    for weight, row, spread in rows:
        if spread is None or len(scenes) < 2:
            return Interval(mean)
        of_seeds[spread] = of_seeds.get(spread, 0.0) + spread.variance * weight**2 / len(row)
    parts = [(part, spread.freedom) for spread, part in of_seeds.items()]
    if not same_scenes:
        parts.append((float(np.var(differences, ddof=1)) / len(scenes), len(scenes) - 1))
    confidence = 1 - (1 - confidence) / looks
    # a part that comes out small by chance lends its degrees of freedom to the others: no sum is narrower than a part
    half = max(_half_width(chosen, confidence) for chosen in (parts, *([part] for part in parts)))
    return Interval(mean, mean - half, mean + half)


def _half_width(parts: Sequence[tuple[float, int]], confidence: float) -> float:
    """Half of Student's t interval for a sum of estimated variances, each with its degrees of freedom."""
    variance = sum(part for part, _ in parts)
    if not variance:
        return 0.0
    freedom = variance**2 / sum(part**2 / freedom for part, freedom in parts)
    return float(stdtrit(freedom, (1 + confidence) / 2)) * math.sqrt(variance)
