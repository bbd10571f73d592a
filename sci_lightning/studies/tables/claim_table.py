"""The paper's claims about its tables, and what our runs decide about them."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from sci_lightning.studies.tables.cost import Cost
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.line import METRICS, Line, lines_of
from sci_lightning.studies.tables.run import RunSetting, ScoredRun
from sci_lightning.studies.tables.score_table import DIGITS, seeds
from sci_lightning.studies.tables.verdict import CONFIDENCE, ENOUGH_LEARNED, Interval, SeedSpread, interval, seed_spread

SCOPES = {"on these scenes": True, "on other scenes": False}
"""For what a verdict is given: other trainings tested on the very same scenes, or other trainings and other scenes."""
HEADING = ["claim", "place in the paper", "row", "PSNR (dB)", "SSIM", "Q-Score", *SCOPES, "scale", "seeds"]
NOTE = (
    "On these scenes: would other trainings, tested on the same scenes, have the same sign? On other scenes: would it "
    f"hold on scenes drawn like these as well? Reproduced: the whole {CONFIDENCE:.0%} interval lies on the claim's "
    "side; contradicted: on the other one. The spread of the seeds is pooled over all rows with several, separately "
    "for rows tested through their own encoder and for rows tested through another one. A row decides nothing if its "
    f"training, tested with its own encoder, learned less than {ENOUGH_LEARNED:g} dB beyond the mean measurement. "
    "Where the compared trainings of a network differ by more than a quarter in their steps, as on processors of "
    "different speed, only the seeds within which they do not differ count, and the spread of the seeds is that of "
    f"trainings of as many steps. Each verdict is at {CONFIDENCE:.0%} by itself, and the comparisons share rows: they "
    "are not so many independent findings."
)
FIGURES_NOTE = "In the cells: the mean difference; its interval on these scenes; on other scenes; the paper's."
MOST_STEPS = 1.25
"""How many times the steps of one training another one of the same network may have made to be compared with it."""
VERDICTS = ("reproduced", "contradicted", "undecided")

Cell = tuple[str, str, str]
"""Table, row and column of a figure of the paper."""
Terms = tuple[tuple[float, Line], ...]
"""Lines with their weights: 1 of what is ahead, -1 of what is behind, the other way round of what a gain is over."""


@dataclass(frozen=True)
class ClaimVerdicts:
    """What the runs say of one comparison of a claim.

    Attributes:
        cells: of the line of the table, from the row on.
        by_scope: for each scope the verdicts by metric; empty where nothing was run.
    """

    cells: list[str]
    by_scope: Mapping[str, Mapping[str, str]]


def claim_table(
    claims: Sequence[Mapping[str, Any]],
    tables: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None = None,
) -> Grid:
    """Return every claim, row by row and metric by metric: the difference, its interval, and what it decides.

    Args:
        claims, tables: of ``paper_figures.yaml``.
        runs: ours.
        costs: of decoders, for claims about what they cost.
    """
    rows: list[list[str]] = []
    verdicts: dict[str, list[str]] = {scope: [] for scope in SCOPES}
    for claim, comparisons in _verdicts(claims, tables, runs, costs):
        for comparison in comparisons:
            rows.append([claim["claim"], claim["place"], *comparison.cells])
            for scope, of_metrics in comparison.by_scope.items():
                verdicts[scope] += of_metrics.values()
    notes = [_counted(scope, given) for scope, given in verdicts.items() if given]
    freedom = Evidence(tables, runs).freedom()
    return Grid("claims", "What the paper claims of its tables", HEADING, rows, [NOTE, FIGURES_NOTE, *freedom, *notes])


def _counted(scope: str, verdicts: Sequence[str]) -> str:
    counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in VERDICTS)
    decided = (len(verdicts) - verdicts.count("undecided")) / len(verdicts)
    return f"{len(verdicts)} comparisons {scope}, each metric by itself: {counts} ({decided:.0%} decided)."


def verdict_table(
    claims: Sequence[Mapping[str, Any]],
    tables: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None = None,
) -> Grid:
    """Return one row for each claim: for each scope how many comparisons are reproduced, contradicted or undecided.

    Args:
        claims, tables, runs, costs: see :func:`claim_table`.
    """
    rows = []
    for claim, comparisons in _verdicts(claims, tables, runs, costs):
        counts = []
        for scope in SCOPES:
            verdicts = [verdict for one in comparisons for verdict in one.by_scope.get(scope, {}).values()]
            given = [f"{verdicts.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in verdicts]
            counts.append(", ".join(given))
        missing = sum(not comparison.by_scope for comparison in comparisons)
        rows.append([claim["claim"], *counts, str(missing or "")])
    heading = ["claim", *SCOPES, "rows not yet run"]
    return Grid("verdicts", "Verdicts on the paper's claims, by row and metric", heading, rows, [NOTE])


def _verdicts(
    claims: Sequence[Mapping[str, Any]],
    tables: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None,
) -> Iterator[tuple[Mapping[str, Any], list[ClaimVerdicts]]]:
    evidence = Evidence(tables, runs)
    for claim in claims:
        yield claim, [_cost_row(claim["cost"], costs or {})] if "cost" in claim else list(evidence.rows(claim))


@dataclass(frozen=True)
class Evidence:
    """What runs say about comparisons of rows and columns of the paper's tables.

    Attributes:
        tables: of ``paper_figures.yaml``.
        runs: ours.
    """

    tables: Mapping[str, Any]
    runs: Sequence[ScoredRun]

    def rows(self, claim: Mapping[str, Any]) -> Iterator[ClaimVerdicts]:
        """The cells of a claim about scores: for each comparison and setting, or once where nothing has been run."""
        metrics, threshold = claim.get("metrics", METRICS), -float(claim.get("within", 0))
        for name, cells in _comparisons(claim, self.tables):
            settings = [terms for terms in self._settings(cells) if _compared(terms, metrics)]
            paper = {
                metric: sum(weight * _paper(self.tables, cell)[METRICS.index(metric)] for weight, cell in cells)
                for metric in metrics
            }
            for terms in settings:
                yield self._compare(name, terms, metrics, threshold, paper)
            if not settings:
                texts = [_figures([], metric, paper) for metric in METRICS]
                yield ClaimVerdicts([name, *texts, *["not yet run"] * len(SCOPES), "", ""], {})

    def _compare(
        self, name: str, terms: Terms, metrics: Iterable[str], threshold: float, paper: Mapping[str, float]
    ) -> ClaimVerdicts:
        setting = terms[0][1].runs[0].setting
        intervals = {
            scope: {
                metric: interval(
                    [(weight, line.of_seeds(metric), self.spread(line, metric)) for weight, line in terms],
                    same_scenes=same_scenes,
                )
                for metric in metrics
                if all(metric in line.mean() for _, line in terms)
            }
            for scope, same_scenes in SCOPES.items()
        }
        verdicts = {
            scope: {metric: difference.verdict(threshold) for metric, difference in of_metrics.items()}
            for scope, of_metrics in intervals.items()
        }
        measured = list(next(iter(intervals.values())))
        reasons = [reason for _, line in terms if (reason := self.unlearned(line))]
        if reasons:
            verdicts = {scope: dict.fromkeys(measured, "undecided") for scope in SCOPES}
        elif any(self.spread(line, metric) is None for metric in measured for _, line in terms):
            reasons = ["no row like these was trained with more than one seed"]
        texts = [
            _figures([of_metrics[metric] for of_metrics in intervals.values() if metric in of_metrics], metric, paper)
            for metric in METRICS
        ]
        because = f" ({'; '.join(dict.fromkeys(reasons))})" if reasons else ""
        summaries = [_summary(of_metrics) + because for of_metrics in verdicts.values()]
        trained = seeds(*(line.runs for _, line in terms))
        return ClaimVerdicts([name, *texts, *summaries, str(setting), trained], verdicts)

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
        groups: dict[Any, list[ScoredRun]] = {}
        for run in self.runs:
            if run.setting == setting and metric in run.scores and _is_own_test(run) == own:
                groups.setdefault((*sorted(map(str, run.fields.items())), run.parameters), []).append(run)
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

    def _settings(self, cells: Sequence[tuple[float, Cell]]) -> Iterator[Terms]:
        """The lines of the cells, once for every setting in which all of them were run; networks are of one size."""
        lines = [[line for line in lines_of(self.tables[cell[0]], self.runs) if line.runs and
                  (line.row, line.column) == cell[1:]] for _, cell in cells]  # fmt: skip
        for combination in product(*lines):
            sizes: dict[str, set[int]] = {}
            for line in combination:
                sizes.setdefault(line.decoder, set()).add(line.runs[0].parameters)
            if len({line.runs[0].setting for line in combination}) > 1 or any(len(size) > 1 for size in sizes.values()):
                continue
            compared = _trained_alike(combination)
            if all(line.runs for line in compared):
                yield tuple((weight, line) for (weight, _), line in zip(cells, compared, strict=True))


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


def _compared(terms: Terms, metrics: Iterable[str]) -> bool:
    """Whether the lines have one of the claim's metrics in common."""
    return any(all(metric in line.mean() for _, line in terms) for metric in metrics)


def _comparisons(claim: Mapping[str, Any], tables: Mapping[str, Any]) -> Iterator[tuple[str, list[tuple[float, Cell]]]]:
    """A row's name, and the cells (table, row, column) that are compared with their weights."""
    ahead, behind = (_side(tables, sign, *claim[side]) for side, sign in (("ahead", 1.0), ("behind", -1.0)))
    for row, cells in ahead.items():
        if claim["behind"][1] != "each":
            for other, others in behind.items():
                yield row if row == other else f"{row}, {other}", cells + others
        elif row in behind:
            yield row, cells + behind[row]


def _side(
    tables: Mapping[str, Any], sign: float, table: str, rows: str | list[str], columns: str | list[str]
) -> dict[str, list[tuple[float, Cell]]]:
    """The cells of one side of a claim, by row; of a gain, the second column is subtracted."""
    columns = [columns] if isinstance(columns, str) else columns
    weights = [sign, -sign][: len(columns)]
    present = [row for row, cells in tables[table]["rows"].items() if all(column in cells for column in columns)]
    return {
        row: [(weight, (table, row, column)) for weight, column in zip(weights, columns, strict=True)]
        for row in present
        if rows == "each" or row in rows
    }


def _paper(tables: Mapping[str, Any], cell: Cell) -> list[float]:
    table, row, column = cell
    return list(tables[table]["rows"][row][column])


def _figures(intervals: Sequence[Interval], metric: str, paper: Mapping[str, float]) -> str:
    """A difference, its intervals and the paper's; only the paper's where nothing was run; empty if not claimed."""
    if metric not in paper:
        return ""
    digits = DIGITS[metric]
    means = [f"{difference.mean:+.{digits}f}" for difference in intervals[:1]]
    bounds = [
        f"[{difference.low:+.{digits}f}, {difference.high:+.{digits}f}]"
        for difference in intervals
        if difference.low != -float("inf")
    ]
    return " ".join([*means, *bounds, f"(paper {paper[metric]:+.{digits}f})"])


def _summary(verdicts: Mapping[str, str]) -> str:
    """``reproduced`` if all metrics agree, else each verdict with its metrics."""
    names = {"psnr": "PSNR", "ssim": "SSIM", "qscore": "Q-Score"}
    if len(set(verdicts.values())) == 1 and len(verdicts) == len(METRICS):
        return f"{next(iter(verdicts.values()))} in all three"
    present = dict.fromkeys(verdicts.values())
    return "; ".join(
        f"{verdict} in {', '.join(names[key] for key, value in verdicts.items() if value == verdict)}"
        for verdict in present
    )


def _cost_row(cost: Mapping[str, Any], costs: Mapping[str, Cost]) -> ClaimVerdicts:
    """The cells of a claim about what a decoder costs, in percent of another one."""
    row = f"{cost['decoder']}, {cost['of']}"
    one, other = (getattr(costs.get(cost[key]), cost["figure"], None) for key in ("decoder", "of"))
    if one is None or other is None:
        return ClaimVerdicts([row, "", "", "", *["not yet run"] * len(SCOPES), "", ""], {})
    percent = 100 * one / other
    verdict = "reproduced" if abs(percent - cost["percent"]) < 0.02 else "contradicted"
    counted = [f"{verdict} ({percent:.2f} %, counted)"] * len(SCOPES)
    cells = [row, "", "", "", *counted, "full networks", "none"]
    return ClaimVerdicts(cells, {scope: {cost["figure"]: verdict} for scope in SCOPES})
