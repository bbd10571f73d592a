"""The proving ground in five pictures: named instead of hidden effects, intervals, probabilities, the gap, and time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullLocator

from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.studies.engine import FailedCase
from sci_lightning.studies.proving_ground.outcome import LEFT_OUT, Outcome
from sci_lightning.studies.proving_ground.reliability import NORMAL, Proportion, Statement, reliability
from sci_lightning.virtual_camera import EFFECTS, OUTSIDE, VOCABULARY

STAGES = ("modulator", "relay", "exposure", "optics", "sensor")
COLOURS = {
    "single": "#1f6fb2",
    "weak": "#7fb3dd",
    "pair": "#1e8a4c",
    "triple": "#c98a00",
    "nothing": "#444444",
    "outside": "#b0488c",
    "fewer": "#7a4fa3",
    "later": "#2a9d9d",
    "faint": "#a9a9a9",
}
BLUE = "#1f6fb2"
MARKERS = ("o", "s", "^", "D")
"""Of the series of one picture."""
LARGEST_ERROR = 5.0
"""Standard deviations; larger errors are drawn here."""


def write_pictures(out: str | Path, records: Iterable[Outcome | FailedCase]) -> list[Path]:
    """Write ``confusion``, ``coverage``, ``reliability``, ``gap`` and ``time`` as PNG, those that have cases."""
    outcomes = [record for record in records if isinstance(record, Outcome)]
    at_most_one = [outcome for outcome in outcomes if outcome.suite in ("single", "nothing", "outside")]
    pictures: dict[str, tuple[Callable[[Sequence[Outcome]], Figure], list[Outcome]]] = {
        "confusion": (confusion_figure, at_most_one),
        "coverage": (coverage_figure, [outcome for outcome in outcomes if outcome.errors]),
        "reliability": (_reliability_figure, [outcome for outcome in outcomes if outcome.statements]),
        "gap": (gap_figure, outcomes),
        "time": (time_figure, outcomes),
    }
    paths = []
    for name, (draw, cases) in pictures.items():
        if cases:
            paths.append(Path(out) / f"{name}.png")
            with atomic_write(paths[-1]) as temporary:
                draw(cases).savefig(temporary, dpi=130, format="png")
    return paths


def confusion_figure(outcomes: Sequence[Outcome]) -> Figure:
    """How often each answer (column) was given for each effect that was hidden alone (row)."""
    hidden = {outcome.hidden_names for outcome in outcomes}
    rows = [name for name in (*VOCABULARY, *OUTSIDE) if (name,) in hidden]
    rows += ["nothing"] if () in hidden else []
    named = {effect.name for outcome in outcomes for effect in outcome.named}
    columns = [*VOCABULARY, *sorted(named - set(VOCABULARY))]
    columns += ["nothing", *(f"unnamed:{stage}" for stage in STAGES), LEFT_OUT]
    share = np.zeros((len(rows), len(columns)))
    for row, name in enumerate(rows):
        cases = [outcome for outcome in outcomes if outcome.hidden_names == (() if name == "nothing" else (name,))]
        for outcome in cases:
            for answer in outcome.answers or ("nothing",):
                share[row, columns.index(answer)] += 1 / len(cases)
    figure = Figure(figsize=(12, 2.8 + 0.25 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(np.ma.masked_equal(share, 0), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    wrong = np.zeros((*share.shape, 4))
    for row, name in enumerate(rows):
        stage = EFFECTS[name].stage if name in OUTSIDE else ""
        right = {"": name, "capture": LEFT_OUT}.get(stage, f"unnamed:{stage}")
        for column, answer in enumerate(columns):
            if share[row, column] and answer != right:
                wrong[row, column] = (0.8, 0.1, 0.1, 0.25 + 0.75 * min(share[row, column], 1))
            if answer == right:
                axes.add_patch(_frame(row, column))
            if percent := round(100 * share[row, column]):
                colour = "white" if percent > 60 else "black"
                axes.text(column, row, str(percent), ha="center", va="center", fontsize=7, color=colour)
    axes.imshow(wrong, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.set(xlabel="found", ylabel="hidden")
    axes.set_xticks(np.arange(len(columns) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(rows) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="#e4e4e4", linewidth=0.5)
    axes.tick_params(which="minor", length=0)
    inside = sum(name in VOCABULARY for name in rows)
    for border in {inside, inside + sum(name in OUTSIDE for name in rows)} - {0, len(rows)}:
        axes.axhline(border - 0.5, color="#444444", linewidth=1)
    title = f"One effect hidden, {len(outcomes)} cases: how often it was given each name (%)"
    axes.set_title(f"{title}\nframed: the right answer; red: a wrong one", fontsize=11)
    return figure


def _frame(row: int, column: int) -> Rectangle:
    return Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="#222222", linewidth=0.9, zorder=3)


def coverage_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Errors in standard deviations beside the normal distribution, and by effect how often intervals hold."""
    errors = [error for outcome in outcomes for error in outcome.errors]
    by_effect: dict[str, list[float]] = {name: [] for name in VOCABULARY}
    for name, error in errors:
        by_effect.setdefault(name.partition(".")[0], []).append(error)
    values = np.clip([error for _, error in errors], -LARGEST_ERROR, LARGEST_ERROR)
    figure = Figure(figsize=(11, 5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1])
    edges = np.linspace(-LARGEST_ERROR, LARGEST_ERROR, 41)
    left.hist(values, edges, density=True, color=BLUE, alpha=0.75, label=f"{len(values)} parameters found")
    grid = np.linspace(-LARGEST_ERROR, LARGEST_ERROR, 300)
    left.plot(grid, np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi), color="#222222", label="normal distribution")
    coverage = Proportion.of(abs(error) <= NORMAL for _, error in errors)
    low, high = coverage.interval
    left.axvspan(-NORMAL, NORMAL, color="#000000", alpha=0.06, zorder=0)
    left.set_title(f"95 % intervals hold the truth in {coverage.share:.1%} ({low:.0%} to {high:.0%})", fontsize=11)
    label = f"(found - true) / stated standard deviation; beyond {LARGEST_ERROR:.0f}: at the end"
    left.set(xlabel=label, ylabel="density")
    left.legend(frameon=False)
    names = [name for name, own in by_effect.items() if own][::-1]
    for place, name in enumerate(names):
        coverage = Proportion.of(abs(error) <= NORMAL for error in by_effect[name])
        right.plot(coverage.interval, (place, place), color=BLUE, linewidth=2, alpha=0.6)
        right.plot(coverage.share, place, "o", color=BLUE, markersize=5)
    right.set_yticks(range(len(names)), [f"{name} ({len(by_effect[name])})" for name in names], fontsize=8)
    right.axvspan(0.9, 0.99, color="#1e8a4c", alpha=0.15)
    right.set(xlim=(0, 1.02), xlabel="share of intervals that hold the truth (green: the target)")
    right.set_title("by effect, with 95 % intervals", fontsize=11)
    return figure


def reliability_figure(worlds: Mapping[str, Sequence[Statement]]) -> Figure:
    """Draw the share of true names over the stated probability, a series for every world."""
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    axes = figure.subplots()
    axes.plot((0, 1), (0, 1), color="#999999", linewidth=1, linestyle=":", label="as often as stated")
    for number, (world, stated) in enumerate(worlds.items()):
        rows, colour = reliability(stated), f"C{number}"
        for row in rows:
            axes.plot((row.stated, row.stated), row.true.interval, color=colour, alpha=0.35, linewidth=2)
        shares = [row.true.share for row in rows]
        marker = MARKERS[number % len(MARKERS)]
        axes.plot(
            [row.stated for row in rows], shares, marker, color=colour, label=f"{world} ({len(stated)} statements)"
        )
        for row in rows:
            axes.annotate(
                str(row.true.total),
                (row.stated, row.true.share),
                (6, -3),
                textcoords="offset points",
                fontsize=7,
                color=colour,
            )
    axes.set(xlim=(-0.02, 1.05), ylim=(-0.02, 1.02), xlabel="stated probability of an effect")
    axes.set_ylabel("share that is true, with 95 % intervals and numbers of statements")
    axes.legend(frameon=False, loc="upper left")
    return figure


def _reliability_figure(outcomes: Sequence[Outcome]) -> Figure:
    """How many of the effects that are stated with some probability are there, in either formulation."""
    formulations = dict.fromkeys(outcome.formulation for outcome in outcomes)
    return reliability_figure(
        {
            one: [s for outcome in outcomes if outcome.formulation == one for s in outcome.statements]
            for one in formulations
        }
    )


def gap_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Held-out chi2 of every case before and after."""
    figure = Figure(figsize=(7.5, 6), layout="constrained")
    axes = figure.subplots()
    before, after = np.array([(outcome.chi2_before, outcome.chi2_after) for outcome in outcomes]).T
    high = 1.3 * max(before.max(), 10)
    for suite, colour in COLOURS.items():
        members = np.array([outcome.suite == suite for outcome in outcomes])
        if members.any():
            axes.plot(before[members], after[members], "o", color=colour, alpha=0.75, markersize=5, label=suite)
    same = np.geomspace(0.5, high, 500)
    axes.plot(same, same, color="#999999", linewidth=1, linestyle=":", label="no change")
    axes.axhline(
        SearchSettings.negligible_chi2,
        color="#222222",
        linewidth=1,
        linestyle="--",
        label=f"target {SearchSettings.negligible_chi2}",
    )
    axes.set(xscale="log", xlim=(0.8, high))
    axes.set(xlabel="held-out reduced chi2 before: ideal camera", ylabel="after: with what was found")
    if after.max() > 2:
        axes.set(yscale="log", ylim=(0.9 * min(after.min(), 1), 1.2 * after.max()))
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_ylim(min(after.min(), 1) - 0.05, max(after.max(), 1.2) + 0.05)
    axes.set_title("The gap between captures and model", fontsize=12)
    axes.legend(frameon=False, fontsize=9)
    return figure


def time_figure(outcomes: Sequence[Outcome]) -> Figure:
    """How long the diagnoses took, by size."""
    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    axes = figure.subplots()
    sizes = sorted({outcome.size for outcome in outcomes})
    seconds = [[outcome.seconds for outcome in outcomes if outcome.size == size] for size in sizes]
    edges = np.linspace(0, 1.05 * max(map(max, seconds)), 36).tolist()
    labels = [
        f"{height} x {width} ({len(times)} cases, median {np.median(times):.1f} s)"
        for (height, width), times in zip(sizes, seconds, strict=True)
    ]
    axes.hist(seconds, edges, stacked=True, label=labels)
    axes.set(xlabel="seconds from captures to report", ylabel="cases")
    axes.set_title("Time of a diagnosis", fontsize=12)
    axes.legend(frameon=False)
    return figure
