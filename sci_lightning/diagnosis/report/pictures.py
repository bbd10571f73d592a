"""Figures of a diagnosis: for the report's page, for files beside it and for dashboards."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.report.snapshot_pictures import snapshot_figures
from sci_lightning.diagnosis.report.svg import AFTER, BEFORE, FAINT, style
from sci_lightning.diagnosis.residual_tests import Picture, Residuals, ResidualTest
from sci_lightning.diagnosis.residual_tests.drawing import OWN, draw_map, draw_test, hidden_by, limits, nearly_largest
from sci_lightning.diagnosis.residual_tests.pixel_tests import PLACE, extent
from sci_lightning.diagnosis.result import CalibratedResult
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.diagnosis.search.selection import Round
from sci_lightning.figures.figure import NotebookFigure
from sci_lightning.plain_text import in_figure

MAX_CANDIDATES = 8
"""Candidates of a round that are drawn."""
MAX_TICKS = 5
"""Labels on a logarithmic axis."""
PANEL_WIDTH = 2.2
"""Width of one map of residuals, in inches."""
PAGE_WIDTH = 6.6
"""Width of a figure of several panels, in inches: a telephone of 400 pixels shows it whole, with legible labels."""
MEAN, SIZE = "mean (standard errors)", "RMS (σ; noise: 1)"


def residuals_figure(before: Residuals, after: Residuals) -> Figure:
    """Draw mean and root mean square of the residuals of every pixel over all captures.

    If the residuals after cannot be seen on the scale of those before, a third row shows them on their own scale.
    """
    both = before.raw, after.raw
    means = [Picture("map", raw.mean(0) * len(raw) ** 0.5, axes=PLACE, extent=extent(before)) for raw in both]
    sizes = [raw.square().mean(0).sqrt() for raw in both]
    spans = [(0.0, max(nearly_largest(size), 1.5)) for size in (torch.stack(sizes), sizes[1])]
    own = hidden_by(means[0], means[1])
    rows = 3 if own else 2
    height, width = before.raw.shape[1:]
    tall = PANEL_WIDTH * min(max(height / width, 0.5), 1.5)  # room left beside an image would be taken from its labels
    with style():
        figure = NotebookFigure(figsize=(PAGE_WIDTH, rows * (tall + 0.45) + 0.3), layout="constrained")
        grid = figure.subplots(rows, 2, sharex=True, sharey=True)
        for column, when in enumerate(("before: the ideal camera", "after: with what was found")):
            mean: Any = draw_map(grid[0, column], means[column], *limits(means))
            size = _sizes(grid[1, column], sizes[column], spans[0], means[column].extent)
            grid[0, column].set_title(when, loc="left")
        _colour_bar(figure, mean, list(grid[0]), MEAN)
        _colour_bar(figure, size, list(grid[1]), SIZE)
        if own:
            mean = draw_map(grid[2, 0], means[1], *limits(means[1:]))
            size = _sizes(grid[2, 1], sizes[1], spans[1], means[1].extent)
            for axes, image, label in ((grid[2, 0], mean, MEAN), (grid[2, 1], size, SIZE)):
                axes.set_title(OWN, loc="left")
                _colour_bar(figure, image, [axes], label)
        for number, axes in enumerate(grid.ravel()):  # label_outer() no longer knows the places beside colour bars
            last, first = number >= grid.size - 2, number % 2 == 0
            axes.set(xlabel=PLACE[0] if last else "", ylabel=PLACE[1] if first else "")
            axes.tick_params(labelbottom=last, labelleft=first)
            axes.spines[:].set_visible(False)
        return figure


def _sizes(axes: Any, values: torch.Tensor, span: tuple[float, float], place: Any) -> Any:
    return axes.imshow(values.numpy(), vmin=span[0], vmax=span[1], interpolation="nearest", extent=place)


def _colour_bar(figure: Figure, image: Any, axes: list[Any], label: str) -> None:
    figure.colorbar(image, ax=axes, aspect=25, label=label).outline.set_visible(False)


def example_figure(before: Residuals, after: Residuals) -> Figure:
    """Draw the held-out capture that the ideal camera misses most: as recorded, and its residuals before and after."""
    seen = before.observation
    held_out = before.fit.fitter.split.held_out_capture
    misfit = before.raw.square().mean((1, 2))
    number = int(torch.where(held_out, misfit, -1.0).argmax() if held_out.any() else misfit.argmax())
    pictures = [
        Picture("map", residuals.raw[number], axes=PLACE, extent=extent(before)) for residuals in (before, after)
    ]
    own = hidden_by(*pictures)
    name = f"capture {int(seen.number[number])} ({seen.kinds[number]})"
    titles = {"recorded": name, "before": "residual before", "after": "residual after", "own": OWN}
    panels: list[Any] = [["recorded", "own"], ["before", "after"]] if own else [["recorded", "before", "after"]]
    with style():
        figure = NotebookFigure(figsize=(PAGE_WIDTH, 5.4 if own else 2.3), layout="constrained")
        grid: dict[str, Any] = figure.subplot_mosaic(panels, sharex=True, sharey=True)
        recorded: Any = grid["recorded"].imshow(
            seen.dn[number].numpy(), cmap="gray", vmin=0, interpolation="nearest", extent=extent(before)
        )
        for name, picture in zip(("before", "after"), pictures, strict=True):
            residual: Any = draw_map(grid[name], picture, *limits(pictures))
        _colour_bar(figure, recorded, [grid["recorded"]], "DN")
        _colour_bar(figure, residual, [grid["before"], grid["after"]], "residual (σ)")
        if own:
            alone: Any = draw_map(grid["own"], pictures[1], *limits(pictures[1:]))
            _colour_bar(figure, alone, [grid["own"]], "residual (σ)")
        for name, axes in grid.items():
            lowest, first = name in panels[-1], name in (panels[0][0], panels[-1][0])
            axes.set_title(titles[name], loc="left")
            axes.set(xlabel=PLACE[0] if lowest else "", ylabel=PLACE[1] if first else "")
            axes.tick_params(labelbottom=lowest, labelleft=first)
            axes.spines[:].set_visible(False)
        return figure


def histogram_figure(before: Residuals, after: Residuals) -> Figure:
    """Draw the distribution of the residuals beside the standard normal that they follow if the model is right."""
    with style():
        figure = NotebookFigure(figsize=(5.4, 3.4), layout="constrained")
        axes = figure.subplots()
        edges = np.linspace(-8, 8, 81)
        middle = (edges[1:] + edges[:-1]) / 2
        least = 0.3 / before.raw.numel() / (edges[1] - edges[0])
        for residuals, colour, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
            count, _ = np.histogram(residuals.raw.clamp(-7.99, 7.99).numpy(), edges, density=True)
            axes.stairs(count.clip(least), edges, color=colour, linewidth=1.4, label=label, baseline=least)
        axes.plot(middle, np.exp(-(middle**2) / 2) / np.sqrt(2 * np.pi), "--", color=FAINT, label="standard normal")
        axes.set(yscale="log", ylim=(least, 1), xlabel="residual (σ; all beyond 8 at 8)", ylabel="density")
        axes.legend(loc="lower center")
        return figure


def evidence_figure(rounds: tuple[Round, ...], names: tuple[str, ...]) -> Figure:
    """Draw what every round considered: the gain of each candidate as screened, and in a joint fit.

    Args:
        rounds: of the search.
        names: effects that are in the model in the end.
    """
    with style():
        figure = NotebookFigure(figsize=(5.4, 0.8 + 2.1 * max(1, len(rounds))), layout="constrained")
        grid = figure.subplots(max(1, len(rounds)), 1, squeeze=False, sharex=True)[:, 0]
        for number, (axes, considered) in enumerate(zip(grid, rounds, strict=False), start=1):
            fits = {name: considered.fitted.get(name, (0.0, 0.0))[0] for name in considered.screened}
            gains = {name: max(gain, fits[name]) for name, gain in considered.screened.items()}
            shown = sorted(gains, key=gains.__getitem__, reverse=True)[:MAX_CANDIDATES][::-1]
            place = np.arange(len(shown))
            screened = [max(considered.screened[name], 0.1) for name in shown]
            fitted = [max(fits[name], 0.1) for name in shown]
            colours = [AFTER if name == considered.added else FAINT for name in shown]
            axes.barh(place, fitted, height=0.62, color=colours, label="joint fit")
            axes.plot(screened, place, "|", color=BEFORE, markersize=9, markeredgewidth=1.6, label="at a glance")
            axes.set_yticks(place, list(map(in_figure, shown)))
            axes.set_xscale("log")
            axes.set_xlim(left=1)
            _label_decades(axes)
            axes.tick_params(labelbottom=True)
            added = considered.added
            dropped = " (dropped later)" if added and added not in names else ""
            axes.set_title(f"round {number}: {in_figure(added or 'nothing more is added')}{dropped}", loc="left")
        if len(rounds):
            figure.supxlabel("gain in log-likelihood (nats)", fontsize=9)
            figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8)
        return figure


def _label_decades(axes: Any) -> None:
    """Make the labels of a logarithmic horizontal axis few and short, so that none overlaps another."""
    axes.xaxis.set_major_locator(LogLocator(numticks=MAX_TICKS))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: short(value)))


def short(value: float) -> str:
    """Return a number with a few digits, in thousands (k), millions (M) or thousand millions (G) if it is large."""
    for factor, letter in ((1e9, "G"), (1e6, "M"), (1e4, "k")):
        if value >= factor:
            return f"{value / (1e3 if letter == 'k' else factor):.4g}{letter}"
    return f"{value:.4g}"


def gap_figure(gap_before: Gap, gap_after: Gap) -> Figure:
    """Draw the reduced chi2 of every kind of capture before and after."""
    kinds = list(gap_before.by_kind)[::-1]
    with style():
        figure = NotebookFigure(figsize=(5.4, 0.9 + 0.34 * (len(kinds) + 1)), layout="constrained")
        axes = figure.subplots()
        pairs = [(gap_before.by_kind[kind].chi2, gap_after.by_kind[kind].chi2) for kind in kinds]
        pairs.append((gap_before.chi2, gap_after.chi2))
        for place, (before, after) in enumerate(pairs):
            axes.plot((before, after), (place, place), color=FAINT, linewidth=1, zorder=1)
        for values, colour, label in zip(zip(*pairs, strict=True), (BEFORE, AFTER), ("before", "after"), strict=True):
            axes.scatter(values, range(len(pairs)), s=34, color=colour, label=label, zorder=2)
        axes.axvline(1, color=FAINT, linewidth=0.8, linestyle="--")
        axes.set_yticks(range(len(pairs)), [*kinds, "all"])
        axes.set_xscale("log")
        low, high = min(min(pair) for pair in pairs), max(max(pair) for pair in pairs)
        axes.set_xlim(min(0.8, 0.9 * low), max(1.3, 1.2 * high))
        _label_decades(axes)
        if high < 8:
            axes.set_xticks([tick for tick in (0.8, 1, 1.2, 1.5, 2, 3, 5) if tick <= max(1.3, 1.2 * high)])
        axes.set_xlabel("reduced chi2 on held-out pixels (1 = noise)")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        return figure


def correlation_figure(names: list[str], correlation: torch.Tensor) -> Figure:
    """Draw how the errors of the parameters are correlated.

    Args:
        names: of the K parameters.
        correlation: ``(K, K)``, -1 to 1.
    """
    with style():
        side = 1.6 + 0.42 * len(names)
        figure = NotebookFigure(figsize=(side + 1.2, side), layout="constrained")
        axes = figure.subplots()
        others = correlation.clone().fill_diagonal_(math.nan)
        image = axes.imshow(others.numpy(), cmap="RdBu_r", vmin=-1, vmax=1)
        labels = list(map(in_figure, names))
        axes.set_xticks(range(len(names)), labels, rotation=40, ha="right")
        axes.set_yticks(range(len(names)), labels)
        axes.spines[:].set_visible(False)
        for row, column in ((r, c) for r in range(len(names)) for c in range(len(names)) if r != c):
            value = float(correlation[row, column])
            colour = "white" if abs(value) > 0.6 else "black"
            axes.text(column, row, f"{round(value, 2) + 0.0:.2f}", ha="center", va="center", fontsize=8, color=colour)
        figure.colorbar(image, ax=axes, shrink=0.8, label="correlation").outline.set_visible(False)
        return figure


def map_figure(values: torch.Tensor, unit: str) -> Figure:
    """Draw an estimated map: an image, or a profile along rows or columns.

    Args:
        values: ``(H, W)``, ``(H, 1)`` or ``(1, W)``.
        unit: of the values.
    """
    with style():
        if min(values.shape) == 1:
            figure = NotebookFigure(figsize=(6.4, 2.4), layout="constrained")
            axes = PLACE[values.shape[0] > 1], unit
            line = Picture("curve", values.flatten(), unit, tuple(map(float, range(values.numel()))), axes[:1])
            draw_test(figure, [line], [""], [AFTER])
        else:
            figure = NotebookFigure(figsize=(4.6, 3.6), layout="constrained")
            draw_test(figure, [Picture("map", values, unit, axes=PLACE)], [""], [AFTER])
        return figure


def unnamed_figure(unnamed: Unnamed) -> Figure:
    """Draw a deviation without a name: how much it changes the signal, and where."""
    with style():
        figure = NotebookFigure(figsize=(5, 3.6 if unnamed.picture.ndim == 2 else 2.6), layout="constrained")
        axes = figure.subplots()
        values = unnamed.picture.numpy()
        if values.ndim == 2:
            image = axes.imshow(values, vmin=min(0, values.min()), interpolation="nearest")
            axes.set(xlabel=PLACE[0], ylabel=PLACE[1])
            axes.spines[:].set_visible(False)
            label = "RMS change of the signal (DN)"
            figure.colorbar(image, ax=axes, shrink=0.85, label=label).outline.set_visible(False)
        else:
            axes.plot(values, color=AFTER, marker=".")
            axes.axhline(0, color=FAINT, linewidth=0.8)
        axes.set_title(in_figure(f"{unnamed.stage}: {unnamed.where}"), loc="left")
        return figure


def test_figure(before: ResidualTest | None, after: ResidualTest) -> Figure:
    """Draw what a residual test saw before and after; after alone if it could not be made before."""
    panels = [("before", BEFORE, before)] if before else []
    panels.append(("after", AFTER, after))
    titles, colours, tests = zip(*panels, strict=True)
    own = before is not None and hidden_by(before.picture, after.picture)
    with style():
        height = 2.5 if after.picture.kind == "map" else 2.1
        panel = 2.0 if own else 2.8  # three panels are no wider than two
        figure = NotebookFigure(figsize=(panel * (len(tests) + own) + 0.6, height), layout="constrained")
        draw_test(figure, [test.picture for test in tests], titles, colours, own)
        return figure


def figures(diagnosis: CalibratedResult | BlindDiagnosis) -> dict[str, Figure]:
    """Draw the figures that lie beside the report, by file name."""
    if isinstance(diagnosis, BlindDiagnosis):
        return snapshot_figures(diagnosis)
    before, after = diagnosis.before.residuals, diagnosis.after.residuals
    pictures = {
        "residuals.png": residuals_figure(before, after),
        "example.png": example_figure(before, after),
        "histogram.png": histogram_figure(before, after),
        "gap.png": gap_figure(diagnosis.before.gap, diagnosis.after.gap),
        "evidence.png": evidence_figure(diagnosis.rounds, diagnosis.names),
    }
    return pictures | {
        f"unnamed_{number}.png": unnamed_figure(unnamed) for number, unnamed in enumerate(diagnosis.unnamed, start=1)
    }
