"""Verdicts: intervals cover the truth as often as they say, on simulated scores."""

from __future__ import annotations

import numpy as np
import pytest

from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.verdict import Interval, Scores, SeedSpread, interval, seed_spread

SCENES = [f"scene{number}" for number in range(6)]


def scores(values: np.ndarray) -> Scores:
    """Scores (seeds, scenes) as runs have them."""
    return [dict(zip(SCENES, map(float, seed), strict=True)) for seed in values]


@pytest.mark.parametrize(
    ("of_scenes", "of_seeds", "interaction"), [(1.0, 0.0, 0.1), (1.0, 0.5, 0.1), (0.2, 1.0, 0.2), (0.0, 0.3, 1.0)]
)
@pytest.mark.parametrize("seeds", [(3, 3), (3, 1), (1, 1)])
def test_coverage(seeds: tuple[int, int], of_scenes: float, of_seeds: float, interaction: float) -> None:
    """At least 94 % of the 95 % intervals hold the true difference, whichever of scenes and seeds varies more.

    Scenes are of very different difficulty, which the pairing removes. Six other rows were trained with three seeds.
    """
    random, trials, held, widths = np.random.default_rng(0), 600, 0, []
    for _ in range(trials):
        difficulty = random.normal(28, 5, 6)

        def row(count: int, ahead: np.ndarray | float, difficulty: np.ndarray = difficulty) -> Scores:
            seeds = random.normal(0, of_seeds, (count, 1)) + random.normal(0, interaction, (count, 6))
            return scores(difficulty + ahead + seeds)

        ahead, behind = row(seeds[0], random.normal(0.4, of_scenes, 6)), row(seeds[1], 0.0)
        spread = seed_spread([ahead, behind, *(row(3, 0.0) for _ in range(6))])
        difference = interval([(1, ahead, spread), (-1, behind, spread)])
        held += difference.low <= 0.4 <= difference.high
        widths.append(difference.high - difference.low)
    assert held / trials >= 0.935  # 0.95 less nearly two standard deviations of so many trials
    assert np.mean(widths) < 4 * 2 * 1.96 * np.hypot(of_scenes, 2 * np.hypot(of_seeds, interaction))


def test_the_interval_of_scenes_alone_is_the_paired_t_interval() -> None:
    random = np.random.default_rng(1)
    ahead, behind = random.normal(30, 3, (2, 6)), random.normal(29, 3, (2, 6))
    ahead[1], behind[1] = ahead[0], behind[0]  # two seeds that do not differ
    spread = seed_spread([scores(ahead), scores(behind)])
    difference = interval([(1, scores(ahead), spread), (-1, scores(behind), spread)])
    gap = ahead[0] - behind[0]
    half = 2.5706 * gap.std(ddof=1) / np.sqrt(6)  # Student's t, 5 degrees of freedom
    assert difference.mean == pytest.approx(gap.mean())
    assert (difference.low, difference.high) == pytest.approx((gap.mean() - half, gap.mean() + half), rel=1e-4)


def test_the_spread_of_seeds_is_pooled() -> None:
    rows = [scores(np.full((3, 6), 20.0) + np.array([[0.0], [1.0], [2.0]])), scores(np.full((1, 6), 5.0))]
    spread = seed_spread([*rows, scores(np.array([[1.0] * 6, [3.0] * 6]))])
    assert spread is not None and spread.freedom == 3 and spread.variance == pytest.approx((2 + 2) / 3)
    assert seed_spread(rows[1:]) is None
    single = interval([(1, rows[0], None), (-1, rows[1], None)])
    assert single.mean == 16 and single.verdict() == "undecided"


@pytest.mark.parametrize("ratio", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("seeds", [2, 3])
def test_on_the_same_scenes_only_the_seeds_count(seeds: int, ratio: float) -> None:
    """The truth is then the difference on these scenes; 95 % intervals hold it, whatever scenes do to it.

    The row behind has seeds that vary ``1 / ratio`` times as much, and its spread is known from itself alone.
    """
    random, trials, held = np.random.default_rng(2), 1000, 0
    for _ in range(trials):
        of_scenes = random.normal(0.4, 5, 6)

        def row(count: int, deviation: float, ahead: np.ndarray | float = 0.0) -> Scores:
            return scores(random.normal(0, deviation, (count, 1)) + np.zeros(6) + ahead)

        calm = [row(seeds, 0.7 * ratio, of_scenes), *(row(2, 0.7 * ratio) for _ in range(4))]
        restless = row(seeds, 0.7)
        rows = [(1.0, calm[0], seed_spread(calm)), (-1.0, restless, seed_spread([restless]))]
        difference = interval(rows, same_scenes=True)
        held += difference.low <= of_scenes.mean() <= difference.high
    assert held / trials >= 0.935


def decided_falsely(trials: int, looks: int, same_scenes: bool) -> float:
    """How often two rows that do not differ are decided, when a seed is added to both until they are or four are there.

    The plan of looks has as many as are given. Eight other rows get as many seeds, and the spread is pooled over all.
    """
    random, false = np.random.default_rng(3), 0
    for _ in range(trials):
        of_scenes = 0.0 if same_scenes else random.normal(0, 0.3, 6)
        seeds = random.normal(0, 0.2, (10, 4, 1)) + random.normal(0, 0.1, (10, 4, 6))
        seeds[0] += of_scenes
        for count in (1, 2, 3, 4):
            rows = [scores(row[:count]) for row in seeds]
            spread = seed_spread(rows if count > 1 else [scores(row[:2]) for row in seeds[2:]])
            pair = [(1.0, rows[0], spread), (-1.0, rows[1], spread)]
            if interval(pair, same_scenes=same_scenes, looks=looks).verdict() != "undecided":
                false += 1
                break
    return false / trials


TRIALS = [pytest.param(700, id="fast"), pytest.param(5_000, id="long", marks=pytest.mark.slow)]


@pytest.mark.parametrize("trials", TRIALS)
@pytest.mark.parametrize("same_scenes", [True, False])
def test_few_decisions_are_false_whenever_one_stops(trials: int, same_scenes: bool) -> None:
    """At most 5 % with the plan of looks, and more than twice as many where four looks are counted as one."""
    assert decided_falsely(trials, paper_figures()["looks"], same_scenes) <= 0.05
    if same_scenes:
        assert decided_falsely(trials, 1, same_scenes) > 0.09


@pytest.mark.parametrize("trials", TRIALS)
@pytest.mark.parametrize("looks", [1, 4])
def test_fixed_scenes_are_covered_as_often_as_stated(trials: int, looks: int) -> None:
    """Intervals of one look hold the truth as often as their share of the confidence says, not much more often."""
    random, held = np.random.default_rng(4), 0
    for _ in range(trials):
        of_scenes = random.normal(0.4, 5, 6)
        seeds = random.normal(0, 0.2, (6, 3, 1)) + np.zeros((6, 3, 6))
        spread = seed_spread([scores(row) for row in seeds])
        pair = [(1.0, scores(seeds[0] + of_scenes), spread), (-1.0, scores(seeds[1]), spread)]
        difference = interval(pair, same_scenes=True, looks=looks)
        held += difference.low <= of_scenes.mean() <= difference.high
    stated = 1 - 0.05 / looks
    assert abs(held / trials - stated) < 4 * np.sqrt(stated * (1 - stated) / trials)


def test_scenes_widen_the_interval() -> None:
    spread = SeedSpread(0.01, 6)
    rows = [(1.0, scores(np.arange(6.0)[None]), spread), (-1.0, scores(np.zeros((1, 6))), spread)]
    alone, both = interval(rows, same_scenes=True), interval(rows)
    assert alone.high - alone.low < 1 < 3 < both.high - both.low and alone.mean == both.mean == 2.5


@pytest.mark.parametrize(
    ("low", "high", "threshold", "paper", "verdict"),
    [
        (0.1, 1, 0, None, "reproduced"),
        (0.1, 1, 0, 0.9, "reproduced"),
        (0.1, 1, 0, 7.75, "sign only"),
        (0.1, 1, 0, 0.003, "sign only"),
        (-1, -0.1, 0, 0.5, "contradicted"),
        (-1, 1, 0, 3, "undecided"),
        (-0.9, -0.1, -1, None, "reproduced"),
    ],
)
def test_verdicts(low: float, high: float, threshold: float, paper: float | None, verdict: str) -> None:
    assert Interval((low + high) / 2, low, high).verdict(threshold, paper) == verdict
