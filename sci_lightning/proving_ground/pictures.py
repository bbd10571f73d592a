"""The proving ground in four pictures: what is taken for what, intervals, the gap, and time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullLocator

from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.proving_ground.outcome import Outcome
from sci_lightning.proving_ground.proportion import NORMAL, Proportion
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
}
BLUE = "#1f6fb2"
FURTHEST = 5.0
"""Standard deviations; errors beyond are drawn here."""


def write_pictures(out: str | Path, records: Iterable[Mapping[str, Any]]) -> list[Path]:
    """``confusion.png``, ``coverage.png``, ``gap.png`` and ``time.png``; those that there are cases for."""
    outcomes = [Outcome(each) for each in records if "failed" not in each]
    alone = [each for each in outcomes if each.suite in ("single", "nothing", "outside")]
    ways = {
        "confusion": (confusion_figure, alone),
        "coverage": (coverage_figure, [each for each in outcomes if each.errors]),
        "gap": (gap_figure, outcomes),
        "time": (time_figure, outcomes),
    }
    paths = []
    for name, (draw, some) in ways.items():
        if some:
            paths.append(Path(out) / f"{name}.png")
            with whole_file(paths[-1]) as temporary:
                draw(some).savefig(temporary, dpi=130, format="png")
    return paths


def confusion_figure(outcomes: Sequence[Outcome]) -> Figure:
    """What was hidden by itself (rows) and how often each name was given for it (columns)."""
    tried = {each.hidden for each in outcomes}
    rows = [name for name in (*VOCABULARY, *OUTSIDE) if (name,) in tried]
    rows += ["nothing"] if () in tried else []
    columns = [*VOCABULARY, *sorted({said for each in outcomes for said in each.found} - set(VOCABULARY))]
    columns += ["nothing", *(f"unnamed:{stage}" for stage in STAGES)]
    share = np.zeros((len(rows), len(columns)))
    for row, name in enumerate(rows):
        cases = [each for each in outcomes if each.hidden == (() if name == "nothing" else (name,))]
        for each in cases:
            for said in each.found + each.unnamed or ("nothing",):
                share[row, columns.index(said)] += 1 / len(cases)
    figure = Figure(figsize=(12, 2.8 + 0.25 * len(rows)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(np.ma.masked_equal(share, 0), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    wrong = np.zeros((*share.shape, 4))
    for row, name in enumerate(rows):
        right = _right(name)
        for column, said in enumerate(columns):
            if share[row, column] and said not in right:
                wrong[row, column] = (0.8, 0.1, 0.1, 0.25 + 0.75 * min(share[row, column], 1))
            if said in right:
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


def _right(name: str) -> set[str]:
    return {f"unnamed:{EFFECTS[name].stage}"} if name in OUTSIDE else {name}


def _frame(row: int, column: int) -> Rectangle:
    return Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="#222222", linewidth=0.9, zorder=3)


def coverage_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Errors in standard deviations beside the normal distribution, and how often each effect's intervals hold."""
    errors = [pair for each in outcomes for pair in each.errors]
    values = np.clip([error for _, error in errors], -FURTHEST, FURTHEST)
    figure = Figure(figsize=(11, 5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1])
    edges = np.linspace(-FURTHEST, FURTHEST, 41)
    left.hist(values, edges, density=True, color=BLUE, alpha=0.75, label=f"{len(values)} parameters found")
    grid = np.linspace(-FURTHEST, FURTHEST, 300)
    left.plot(grid, np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi), color="#222222", label="normal distribution")
    held = Proportion.of(abs(error) <= NORMAL for _, error in errors)
    low, high = held.interval
    left.axvspan(-NORMAL, NORMAL, color="#000000", alpha=0.06, zorder=0)
    left.set_title(f"95 % intervals hold the truth in {held.share:.1%} ({low:.0%} to {high:.0%})", fontsize=11)
    left.set(xlabel=f"(found - true) / stated standard deviation; beyond {FURTHEST:.0f}: at the end", ylabel="density")
    left.legend(frameon=False)
    names = [name for name in VOCABULARY if any(each.startswith(f"{name}.") for each, _ in errors)]
    for place, name in enumerate(reversed(names)):
        own = Proportion.of(abs(error) <= NORMAL for each, error in errors if each.startswith(f"{name}."))
        right.plot(own.interval, (place, place), color=BLUE, linewidth=2, alpha=0.6)
        right.plot(own.share, place, "o", color=BLUE, markersize=5)
    labels = [f"{name} ({sum(each.startswith(f'{name}.') for each, _ in errors)})" for name in reversed(names)]
    right.set_yticks(range(len(names)), labels, fontsize=8)
    right.axvspan(0.9, 0.99, color="#1e8a4c", alpha=0.15)
    right.set(xlim=(0, 1.02), xlabel="share of intervals that hold the truth (green: the target)")
    right.set_title("by effect, with 95 % intervals", fontsize=11)
    return figure


def gap_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Held-out chi2 of every case before and after."""
    figure = Figure(figsize=(7.5, 6), layout="constrained")
    axes = figure.subplots()
    before, after = np.array([each.chi2 for each in outcomes]).T
    high = 1.3 * max(before.max(), 10)
    for suite, colour in COLOURS.items():
        chosen = np.array([each.suite == suite for each in outcomes])
        if chosen.any():
            axes.plot(before[chosen], after[chosen], "o", color=colour, alpha=0.75, markersize=5, label=suite)
    same = np.geomspace(0.5, high, 500)
    axes.plot(same, same, color="#999999", linewidth=1, linestyle=":", label="no change")
    axes.axhline(NEGLIGIBLE, color="#222222", linewidth=1, linestyle="--", label=f"target {NEGLIGIBLE}")
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
    sizes = sorted({tuple(each.record["size"]) for each in outcomes})
    seconds = [[float(each.record["seconds"]) for each in outcomes if tuple(each.record["size"]) == s] for s in sizes]
    edges = np.linspace(0, 1.05 * max(map(max, seconds)), 36).tolist()
    labels = [
        f"{height} x {width} ({len(some)} cases, median {np.median(some):.1f} s)"
        for (height, width), some in zip(sizes, seconds, strict=True)
    ]
    axes.hist(seconds, edges, stacked=True, label=labels)
    axes.set(xlabel="seconds from captures to report", ylabel="cases")
    axes.set_title("Time of a diagnosis", fontsize=12)
    axes.legend(frameon=False)
    return figure
