"""Contrasts that claims are about, and what runs say of them."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from sci_lightning.studies.tables.line import METRICS, Line, grouped
from sci_lightning.studies.tables.run import RunSetting, ScoredRun
from sci_lightning.studies.tables.verdict import ENOUGH_LEARNED, Interval, SeedSpread, interval, seed_spread

MOST_STEPS = 1.25
"""How many times the steps of one training another one of the same network may have made to be compared with it."""
SAME_SIZE = 0.02
"""By what part of the paper's parameters a published network may differ; the paper prints two to four digits."""

Terms = tuple[tuple[float, Line], ...]
"""Lines with their weights: 1 of what is ahead, -1 of what is behind, the other way round of what a gain is over."""


@dataclass(frozen=True)
class Cell:
    """A figure of the paper: its row and column, the fields of the runs that belong to it, and the figure by metric."""

    row: str
    column: str
    fields: Mapping[str, Any]
    paper: Mapping[str, float]


@dataclass(frozen=True)
class Contrast:
    """One difference that a claim says to lie above a threshold.

    Attributes:
        row: of the table, or both rows.
        ahead, behind: cells with their weights.
        metrics: that the claim is about.
        threshold: 0, or below it what may be lacking.
    """

    row: str
    ahead: tuple[tuple[float, Cell], ...]
    behind: tuple[tuple[float, Cell], ...]
    metrics: tuple[str, ...]
    threshold: float

    @property
    def cells(self) -> tuple[tuple[float, Cell], ...]:
        """All of them."""
        return self.ahead + self.behind

    @property
    def paper(self) -> dict[str, float]:
        """The paper's difference by metric."""
        return {metric: sum(weight * cell.paper[metric] for weight, cell in self.cells) for metric in self.metrics}

    @property
    def shown(self) -> tuple[str, ...]:
        """The metrics in which the paper's own columns show it; all where none does."""
        return tuple(metric for metric, value in self.paper.items() if value > self.threshold) or self.metrics

    def against(self, control: Mapping[str, Any]) -> tuple[tuple[float, Cell], ...] | None:
        """Return the cells with a control in the place of what is behind; None where that is the control already.

        Args:
            control: of ``paper_figures.yaml``: ``fields`` take the place of those of the side ``of``.
        """
        side, sign = (self.ahead, -1.0) if control["of"] == "ahead" else (self.behind, 1.0)
        if any(control.get("except", {"": ""}).items() <= cell.fields.items() for _, cell in side):
            return None
        replaced = (
            (sign * weight, replace(cell, fields={**cell.fields, **control["fields"]})) for weight, cell in side
        )
        return self.ahead + tuple(replaced)


def contrasts(claim: Mapping[str, Any], tables: Mapping[str, Any]) -> Iterator[Contrast]:
    """Yield the contrasts of a claim of ``paper_figures.yaml`` about scores."""
    ahead, behind = (_side(tables, sign, *claim[side]) for side, sign in (("ahead", 1.0), ("behind", -1.0)))
    rest = (tuple(claim.get("metrics", METRICS)), -float(claim.get("within", 0)))
    for row, cells in ahead.items():
        if claim["behind"][1] != "each":
            for other, others in behind.items():
                yield Contrast(row if row == other else f"{row}, {other}", cells, others, *rest)
        elif row in behind:
            yield Contrast(row, cells, behind[row], *rest)


def _side(
    tables: Mapping[str, Any], sign: float, table: str, rows: str | list[str], columns: str | list[str]
) -> dict[str, tuple[tuple[float, Cell], ...]]:
    """The cells of one side of a claim, by row; of a gain, the second column is subtracted."""
    columns = [columns] if isinstance(columns, str) else columns
    sides = {}
    for row, figures in tables[table]["rows"].items():
        if all(column in figures for column in columns) and (rows == "each" or row in rows):
            sides[row] = tuple(
                (
                    weight,
                    Cell(
                        row,
                        column,
                        {**tables[table]["columns"][column], **figures["match"]},
                        dict(zip(METRICS, figures[column], strict=True)),
                    ),
                )
                for weight, column in zip((sign, -sign), columns, strict=False)
            )
    return sides


def other_networks(decoders: Mapping[str, Any], terms: Terms) -> tuple[str, ...]:
    """Return which lines of several networks are not of the published size, a sentence each.

    Args:
        decoders: of ``paper_figures.yaml``.
        terms: the lines.
    """
    sizes = {line.decoder: line.runs[0].parameters / 1e6 for _, line in terms}
    if len(sizes) == 1:
        return ()
    return tuple(
        f"{decoders[name]['row']} has {size:.2g} M parameters here, {decoders[name]['parameters_M']} M in the paper"
        for name, size in sizes.items()
        if abs(size - decoders[name]["parameters_M"]) > SAME_SIZE * decoders[name]["parameters_M"]
    )


@dataclass(frozen=True)
class Evidence:
    """What runs say about contrasts."""

    runs: Sequence[ScoredRun]

    def settings(self, cells: Sequence[tuple[float, Cell]], metrics: Sequence[str]) -> Iterator[Terms]:
        """Yield the lines of the cells, once for every setting in which all of them have one of the metrics.

        Networks of one name are of one size, and masks start in one way.
        """
        lines = [
            [Line(cell.row, cell.column, cell.paper, group, cell.fields["decoder"])
             for group in grouped(cell.fields, self.runs)]
            for _, cell in cells
        ]  # fmt: skip
        for combination in product(*lines):
            sizes: dict[str, set[int]] = defaultdict(set)
            for line in combination:
                sizes[line.decoder].add(line.runs[0].parameters)
            variants = {line.runs[0].variant for line in combination if line.runs[0].variant}
            if len({line.runs[0].setting for line in combination}) > 1 or len(variants) > 1:
                continue
            compared = _trained_alike(combination)
            shared = any(all(metric in line.mean() for line in compared) for metric in metrics)
            if all(len(size) == 1 for size in sizes.values()) and shared:
                yield tuple((weight, line) for (weight, _), line in zip(cells, compared, strict=True))

    def interval(self, terms: Terms, metric: str, looks: int, *, same_scenes: bool) -> Interval:
        """Return the difference in a metric and its interval, see :mod:`~sci_lightning.studies.tables.verdict`."""
        rows = [(weight, line.of_seeds(metric), self.spread(line, metric)) for weight, line in terms]
        return interval(rows, same_scenes=same_scenes, looks=looks)

    def undecided(self, terms: Terms, looks: int) -> list[str]:
        """Return why the lines decide nothing, a sentence each; empty where they may."""
        reasons = [reason for _, line in terms if (reason := self.unlearned(line))]
        if any(len(line.runs) > looks for _, line in terms):
            reasons.append(f"more seeds than the {looks} planned looks")
        metrics = [metric for metric in METRICS if all(metric in line.mean() for _, line in terms)]
        if any(self.spread(line, metric) is None for _, line in terms for metric in metrics):
            reasons.append("no row like these was trained with more than one seed")
        return list(dict.fromkeys(reasons))

    def freedom(self) -> list[str]:
        """How many degrees of freedom the spread of the seeds has in every setting, in a sentence each."""
        sentences = []
        for setting in dict.fromkeys(run.setting for run in self.runs):
            spreads = [self._pooled(setting, own, METRICS[0]) for own in (True, False)]
            own, other = (spread.freedom if spread else 0 for spread in spreads)
            if own or other:
                sentences.append(
                    f"Degrees of freedom of the seeds' spread, {setting}: {own} of rows tested through the encoder "
                    f"that they were trained with, {other} of those tested through another."
                )
        return sentences

    def spread(self, line: Line, metric: str) -> SeedSpread | None:
        """The spread of the seeds of rows like a line, of its setting, tested through their own encoder or another."""
        return self._pooled(line.runs[0].setting, _is_own_test(line.runs[0]), metric)

    def _pooled(self, setting: RunSetting, own: bool, metric: str) -> SeedSpread | None:
        groups: dict[Any, list[ScoredRun]] = defaultdict(list)
        for run in self.runs:
            if run.setting == setting and metric in run.scores and _is_own_test(run) == own:
                groups[str(run.fields), run.group].append(run)
        alike = [group for row in groups.values() for group in _by_steps(row)]
        return seed_spread([{scene: run.scenes[scene][metric] for scene in run.scenes} for run in group]
                           for group in alike)  # fmt: skip

    def unlearned(self, line: Line) -> str:
        """Why a line decides nothing, or nothing: its trainings, tested as they were trained, learned too little."""
        beyond = [
            own.scores["psnr"] - own.baseline["psnr"]
            for run in line.runs
            for own in [self._own_test(run)]
            if own is not None and "psnr" in own.scores.keys() & own.baseline.keys()
        ]
        if len(beyond) < len(line.runs):
            return f"it is not known how much {line.row} learned"
        if (mean := statistics.fmean(beyond)) < ENOUGH_LEARNED:
            return f"{line.row}, {line.column}: {mean:.1f} dB beyond the mean measurement"
        return ""

    def _own_test(self, run: ScoredRun) -> ScoredRun | None:
        """The test of the same training behind its own encoder."""
        fields = {**run.fields, "test_encoder": run.fields["encoder"]}
        alike = (run.setting, run.parameters, run.seed)
        return next((own for own in self.runs if own.fields == fields and
                     (own.setting, own.parameters, own.seed) == alike), None)  # fmt: skip


def _trained_alike(lines: Sequence[Line]) -> list[Line]:
    """Return the lines with the runs that can be compared.

    A processor that makes more steps in the same time must not decide a claim: where the trainings of a network differ
    in their steps, only the seeds are left that all lines have, and within which no network's trainings differ.
    """
    networks: dict[str, list[ScoredRun]] = defaultdict(list)
    for line in lines:
        networks[line.decoder] += line.runs
    if all(_as_many_steps(runs) for runs in networks.values()):
        return list(lines)
    common = set.intersection(*({run.seed for run in line.runs} for line in lines))
    seeds = {
        seed for seed in common
        if all(_as_many_steps([run for run in runs if run.seed == seed]) for runs in networks.values())
    }  # fmt: skip
    return [replace(line, runs=tuple(run for run in line.runs if run.seed in seeds)) for line in lines]


def _by_steps(runs: Sequence[ScoredRun]) -> list[list[ScoredRun]]:
    """Return runs in groups of about as many steps: what differs within a group is the seed and not the processor."""
    groups: list[list[ScoredRun]] = []
    for run in sorted(runs, key=lambda run: run.training_steps or 0):
        if groups and _as_many_steps([*groups[-1], run]):
            groups[-1].append(run)
        else:
            groups.append([run])
    return groups


def _as_many_steps(runs: Sequence[ScoredRun]) -> bool:
    """Whether trainings made about as many steps, as far as that is known."""
    steps = [run.training_steps for run in runs if run.training_steps is not None]
    return not steps or max(steps) <= MOST_STEPS * min(steps)


def _is_own_test(run: ScoredRun) -> bool:
    """Whether a run was tested behind the encoder with which it was trained."""
    return bool(run.fields["test_encoder"] == run.fields["encoder"])
