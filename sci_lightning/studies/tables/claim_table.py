"""The paper's claims about its tables, and what our runs decide about them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sci_lightning.studies.tables.cost import Cost
from sci_lightning.studies.tables.evidence import Contrast, Evidence, Terms, contrasts, other_networks
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.line import METRICS
from sci_lightning.studies.tables.run import ScoredRun
from sci_lightning.studies.tables.score_table import DIGITS, seeds
from sci_lightning.studies.tables.verdict import CONFIDENCE, ENOUGH_LEARNED, Interval

SCOPES = {"on these scenes": True, "on other scenes": False}
"""For what a verdict is given: other trainings tested on the very same scenes, or other trainings and other scenes."""
HEADING = ["claim", "row", "PSNR (dB)", "SSIM", "Q-Score", *SCOPES, "controls", "scale", "seeds"]
VERDICTS = ("reproduced", "sign only", "contradicted", "undecided", "not testable here", "not yet run")
SIDES = {"reproduced": 1, "sign only": 1, "contradicted": -1}
NAMES = dict(zip(METRICS, ("PSNR", "SSIM", "Q-Score"), strict=True))
NOTE = (
    "A verdict is on a contrast, in all metrics in which the paper's columns show it. Reproduced: every interval lies "
    "on the claim's side and holds the paper's difference; sign only: not all of them hold it. Contradicted: every "
    "interval lies on the other side. Not testable here: a control has not been run, or the networks are not the "
    "published ones. All controls must be decided to the same side. On these scenes: for other trainings; on other "
    "scenes: for other scenes drawn like these as well."
)
SEEDS_NOTE = (
    "The spread of the seeds is pooled over all rows with several, apart for rows tested through their own encoder and "
    "for rows tested through another one. A row decides nothing if its training, tested with its own encoder, learned "
    f"less than {ENOUGH_LEARNED:g} dB beyond the mean measurement, or if it has more seeds than there are planned "
    "looks. Where trainings of a network differ by more than a quarter in their steps, only the seeds within which "
    f"they do not differ count. Each verdict is at {CONFIDENCE:.0%} by itself; the contrasts share rows."
)
FIGURES_NOTE = (
    "In the cells: the mean difference; its interval on these scenes; on other scenes; the paper's difference, and the "
    "ratio of ours to it."
)


@dataclass(frozen=True)
class ClaimVerdict:
    """What the runs say of one contrast of a claim in one setting.

    Attributes:
        cells: of the line of the table, from the row on.
        by_scope: for each scope one of :data:`VERDICTS`.
        missing: what it would take to test it, in words; empty where it was tested.
    """

    cells: list[str]
    by_scope: Mapping[str, str]
    missing: tuple[str, ...] = ()


def claim_table(
    paper: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None = None,
    others: Sequence[ScoredRun] = (),
) -> Grid:
    """Return every contrast of every claim: the difference, its interval, its controls, and what it decides.

    Args:
        paper: ``paper_figures.yaml``.
        runs: ours.
        costs: of decoders, for claims about what they cost; None leaves these claims out.
        others: runs by other recipes, which are controls and nothing else.
    """
    rows: list[list[str]] = []
    counts: dict[str, list[str]] = {scope: [] for scope in SCOPES}
    for claim, verdicts in _verdicts(paper, runs, costs, others):
        rows += [[claim["claim"], *verdict.cells] for verdict in verdicts]
        for scope, given in counts.items():
            given += [verdict.by_scope[scope] for verdict in verdicts]
    notes = [f"{len(given)} contrasts {scope}: {_counted(given)}." for scope, given in counts.items()]
    notes = [*notes, NOTE, _looks(paper), SEEDS_NOTE, FIGURES_NOTE, *Evidence(runs).freedom()]
    return Grid("claims", "What the paper claims of its tables", HEADING, rows, notes)


def verdict_table(
    paper: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None = None,
    others: Sequence[ScoredRun] = (),
) -> Grid:
    """Return one row for each claim: how many contrasts have which verdict, and what is missing to test the others.

    Args:
        paper, runs, costs, others: see :func:`claim_table`.
    """
    rows = []
    for claim, verdicts in _verdicts(paper, runs, costs, others):
        counts = [_counted([verdict.by_scope[scope] for verdict in verdicts]) for scope in SCOPES]
        missing = dict.fromkeys(lack for verdict in verdicts for lack in verdict.missing)
        rows.append([claim["claim"], claim["place"], *counts, "; ".join(missing)])
    heading = ["claim", "place in the paper", *SCOPES, "what is missing"]
    return Grid("verdicts", "Verdicts on the paper's claims", heading, rows, [NOTE, _looks(paper)])


def _looks(paper: Mapping[str, Any]) -> str:
    return (
        f"Up to {paper['looks']} looks are planned, one for each seed that is added. At all of them together, at most "
        f"{1 - CONFIDENCE:.0%} decide falsely."
    )


def _counted(verdicts: Sequence[str]) -> str:
    return ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in VERDICTS if verdict in verdicts)


def _verdicts(
    paper: Mapping[str, Any],
    runs: Sequence[ScoredRun],
    costs: Mapping[str, Cost] | None,
    others: Sequence[ScoredRun],
) -> Iterator[tuple[Mapping[str, Any], list[ClaimVerdict]]]:
    tested = Tested(paper, Evidence(runs), Evidence([*runs, *others]))
    for claim in paper["claims"]:
        if "cost" not in claim:
            present = contrasts(claim, paper["tables"])
            names = claim.get("controls", ())
            yield claim, [verdict for contrast in present for verdict in tested.verdicts(contrast, names)]
        elif costs is not None:
            yield claim, [_cost_verdict(claim["cost"], costs)]


@dataclass(frozen=True)
class Tested:
    """The paper's claims on scores, tested by runs.

    Attributes:
        paper: ``paper_figures.yaml``.
        evidence: of the runs, each setting of which gives a verdict of its own.
        every: of these and of runs by other recipes.
    """

    paper: Mapping[str, Any]
    evidence: Evidence
    every: Evidence

    def verdicts(self, contrast: Contrast, controls: Sequence[str]) -> Iterator[ClaimVerdict]:
        """Yield the verdict on a contrast in every setting in which it was run, or one that says that it was not."""
        recipes = {self.paper["controls"][name].get("recipe") for name in controls}
        settings = [
            terms
            for terms in self.evidence.settings(contrast.cells, contrast.metrics)
            if not any(recipes & set(line.words) for _, line in terms)
        ]
        for terms in settings:
            yield self._verdict(contrast, terms, controls)
        if not settings:
            cells = [contrast.row, *(_figures([], metric, contrast.paper) for metric in METRICS)]
            yield ClaimVerdict(
                [*cells, *["not yet run"] * len(SCOPES), "", "", ""], dict.fromkeys(SCOPES, "not yet run")
            )

    def _verdict(self, contrast: Contrast, terms: Terms, controls: Sequence[str]) -> ClaimVerdict:
        intervals = {scope: self._intervals(self.evidence, contrast, terms, scope) for scope in SCOPES}
        undecided = self.evidence.undecided(terms, self.paper["looks"])
        of_controls = {name: given for name in controls if (given := self._control(contrast, terms, name)) is not None}
        lacking = [name for name, given in of_controls.items() if not given]
        missing = other_networks(self.paper["decoders"], terms) or tuple(f"no rows: {name}" for name in lacking)
        by_scope, texts = {}, []
        for scope, differences in intervals.items():
            sized = contrast.paper if not contrast.threshold else {}
            own = {metric: one.verdict(contrast.threshold, sized.get(metric)) for metric, one in differences.items()}
            verdict = "undecided" if undecided else _together(own, contrast.shown)
            because = undecided or [f"{given} in {NAMES[metric]}" for metric, given in own.items() if given != verdict]
            if missing:
                verdict, because = "not testable here", []
            elif any(SIDES.get(given[scope]) != SIDES.get(verdict) for given in of_controls.values()):
                because = [f"{verdict} without the controls"] if verdict in SIDES else because
                verdict = "undecided"
            by_scope[scope] = verdict
            texts.append(verdict + (f" ({'; '.join(because)})" if because else ""))
        figures = [
            _figures([of[metric] for of in intervals.values() if metric in of], metric, contrast.paper)
            for metric in METRICS
        ]
        first = next(iter(SCOPES))
        stated = [f"{name}: {given[first] if given else 'missing'}" for name, given in of_controls.items()]
        origin = [str(terms[0][1].runs[0].setting), seeds(*(line.runs for _, line in terms))]
        return ClaimVerdict([contrast.row, *figures, *texts, "; ".join(stated), *origin], by_scope, missing)

    def _intervals(self, evidence: Evidence, contrast: Contrast, terms: Terms, scope: str) -> dict[str, Interval]:
        """The differences in the metrics that all lines have."""
        measured = [metric for metric in contrast.metrics if all(metric in line.mean() for _, line in terms)]
        looks, same = self.paper["looks"], SCOPES[scope]
        return {metric: evidence.interval(terms, metric, looks, same_scenes=same) for metric in measured}

    def _control(self, contrast: Contrast, terms: Terms, name: str) -> dict[str, str] | None:
        """Return a control's verdict by scope; empty if it was not run, None if it is what is compared already."""
        control, setting = self.paper["controls"][name], terms[0][1].runs[0].setting
        if "recipe" in control:
            evidence = self.every
            alike = evidence.settings(contrast.cells, contrast.metrics)
            rows = [compared for compared in alike if any(control["recipe"] in line.words for _, line in compared)]
        else:
            evidence = self.evidence
            if (cells := contrast.against(control)) is None:
                return None
            alike = evidence.settings(cells, contrast.metrics)
            rows = [compared for compared in alike if compared[0][1].runs[0].setting == setting]
        by_scope: dict[str, str] = {}
        for scope in SCOPES if rows else ():
            given = set()
            for compared in rows:
                own = self._intervals(evidence, contrast, compared, scope).items()
                verdicts = {metric: one.verdict(contrast.threshold) for metric, one in own}
                unsure = evidence.undecided(compared, self.paper["looks"])
                given.add("undecided" if unsure else _together(verdicts, contrast.shown))
            decided = given - {"undecided"}
            by_scope[scope] = decided.pop() if len(decided) == 1 else "undecided"
        return by_scope


def _together(verdicts: Mapping[str, str], shown: Sequence[str]) -> str:
    """Return the verdict on all metrics in which the paper shows it, as far as they were measured."""
    counted = [verdict for metric, verdict in verdicts.items() if metric in shown] or list(verdicts.values())
    sides = {SIDES.get(verdict, 0) for verdict in counted}
    if sides == {1}:
        return "reproduced" if set(counted) == {"reproduced"} else "sign only"
    return "contradicted" if sides == {-1} else "undecided"


def _figures(intervals: Sequence[Interval], metric: str, paper: Mapping[str, float]) -> str:
    """A difference, its intervals and the paper's; only the paper's where nothing was run; empty if not claimed."""
    if metric not in paper:
        return ""
    digits, printed = DIGITS[metric], paper[metric]
    means = [f"{difference.mean:+.{digits}f}" for difference in intervals[:1]]
    bounds = [
        f"[{difference.low:+.{digits}f}, {difference.high:+.{digits}f}]"
        for difference in intervals
        if difference.low != -float("inf")
    ]
    shown = round(printed, digits)
    ratio = [f", ratio {difference.mean / printed:.2g}" for difference in intervals[:1] if shown]
    return " ".join([*means, *bounds, f"(paper {printed:+.{digits}f}{''.join(ratio)})"])


def _cost_verdict(cost: Mapping[str, Any], costs: Mapping[str, Cost]) -> ClaimVerdict:
    """The verdict on a claim about what a decoder costs, in percent of another one."""
    row = f"{cost['decoder']}, {cost['of']}"
    one, other = (getattr(costs.get(cost[key]), cost["figure"], None) for key in ("decoder", "of"))
    if one is None or other is None:
        empty = [row, "", "", "", *["not yet run"] * len(SCOPES), "", "", ""]
        return ClaimVerdict(empty, dict.fromkeys(SCOPES, "not yet run"))
    percent = 100 * one / other
    verdict = "reproduced" if abs(percent - cost["percent"]) < 0.02 else "contradicted"
    counted = [f"{verdict} ({percent:.2f} %, counted)"] * len(SCOPES)
    return ClaimVerdict([row, "", "", "", *counted, "", "full networks", "none"], dict.fromkeys(SCOPES, verdict))
