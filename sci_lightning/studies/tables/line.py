"""Lines of a table: a row and a column of the paper, and the runs that belong to them."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sci_lightning.studies.tables.run import RunSetting, ScoredRun

METRICS = ("psnr", "ssim", "qscore")
"""In the order in which the paper prints them."""


@dataclass(frozen=True)
class Line:
    """One row and column of one of the paper's tables, in one setting.

    Attributes:
        row, column: as the paper names them.
        paper: the paper's figures by metric.
        runs: ours, one for each seed; none: not yet run.
        decoder: whose line it is.
    """

    row: str
    column: str
    paper: Mapping[str, float]
    runs: tuple[ScoredRun, ...] = ()
    decoder: str = ""

    @property
    def group(self) -> tuple[RunSetting, int] | None:
        """What the runs have in common, setting and parameters; None if there are none."""
        return self.runs[0].group[:2] if self.runs else None

    @property
    def words(self) -> tuple[str, ...]:
        """What is to be known of the runs besides, such as ``untiled masks`` and ``designed start``."""
        return (*self.runs[0].setting.recipe, *self.runs[0].variant) if self.runs else ()

    def ours(self) -> dict[str, list[float]]:
        """The scores of every seed by metric, of the metrics that every run has."""
        return {key: [run.scores[key] for run in self.runs] for key in METRICS if self._all_have(key)}

    def mean(self) -> dict[str, float]:
        """The scores' means over the seeds."""
        return {key: statistics.fmean(scores) for key, scores in self.ours().items()}

    def spread(self) -> dict[str, float]:
        """The scores' standard deviations over the seeds, of at least two seeds."""
        return {key: statistics.stdev(scores) for key, scores in self.ours().items() if len(scores) > 1}

    def of_seeds(self, metric: str) -> list[dict[str, float]]:
        """The scores of a metric by scene, of every seed."""
        return [{scene: scores[metric] for scene, scores in run.scenes.items()} for run in self.runs]

    def _all_have(self, metric: str) -> bool:
        return bool(self.runs) and all(metric in run.scores for run in self.runs)


def lines_of(table: Mapping[str, Any], runs: Sequence[ScoredRun]) -> list[Line]:
    """The lines of a table of ``paper_figures.yaml``: one for each row, column and setting, at least an empty one."""
    lines = []
    for name, row in table["rows"].items():
        for column, fields in table["columns"].items():
            if column not in row:  # NA in the paper
                continue
            wanted = {**fields, **row["match"]}
            paper = dict(zip(METRICS, row[column], strict=True))
            lines += [Line(name, column, paper, group, wanted["decoder"]) for group in grouped(wanted, runs) or [()]]
    return lines


def grouped(wanted: Mapping[str, Any], runs: Iterable[ScoredRun]) -> list[tuple[ScoredRun, ...]]:
    """Return the runs with these fields, in groups of those that differ in nothing but the seed."""
    groups = defaultdict(list)
    matching = [run for run in runs if wanted.items() <= run.fields.items()]
    for run in sorted(matching, key=lambda run: (str(run.setting), run.variant, run.seed)):
        groups[run.group].append(run)
    return [tuple(group) for group in groups.values()]
