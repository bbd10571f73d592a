"""Pictures of a diagnosis, for the report's page, for files beside it and for dashboards."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from sci_lightning.diagnosis.diagnosis import Diagnosis
from sci_lightning.diagnosis.leftover import Unnamed
from sci_lightning.diagnosis.residual_tests import Picture, Residuals, ResidualTest
from sci_lightning.diagnosis.residual_tests.drawing import draw_map, draw_test, limits
from sci_lightning.diagnosis.residual_tests.position import PLACE
from sci_lightning.diagnosis.search import Round
from sci_lightning.diagnosis.svg import AFTER, BEFORE, FAINT, style

SHOWN = 8
"""Candidates of a round that are drawn."""


def residuals_figure(before: Residuals, after: Residuals) -> Figure:
    """Where they disagree: mean and root mean square of the residuals of every pixel over all captures."""
    with style():
        figure = Figure(figsize=(8.8, 7.2), layout="constrained")
        grid = figure.subplots(2, 2, sharex=True, sharey=True)
        sizes = [each.raw.square().mean(0).sqrt() for each in (before, after)]
        means = [Picture("map", each.raw.mean(0) * len(each.raw) ** 0.5, axes=PLACE) for each in (before, after)]
        high = max(float(torch.quantile(torch.stack(sizes), 0.998)), 1.5)
        for column, when in enumerate(("before: the ideal camera", "after: with what was found")):
            mean: Any = draw_map(grid[0, column], means[column], *limits(means))
            size = grid[1, column].imshow(sizes[column].numpy(), vmin=0, vmax=high, interpolation="nearest")
            grid[0, column].set_title(when, loc="left")
        for image, row, label in ((mean, grid[0], "mean (standard errors)"), (size, grid[1], "RMS (σ; noise: 1)")):
            figure.colorbar(image, ax=list(row), shrink=0.85, label=label).outline.set_visible(False)
        for axes in grid.ravel():
            axes.set(xlabel=PLACE[0], ylabel=PLACE[1])
            axes.label_outer()
            axes.spines[:].set_visible(False)
        return figure


def example_figure(before: Residuals, after: Residuals) -> Figure:
    """The held-out capture that the ideal camera misses most: as recorded, and its residuals before and after."""
    seen = before.seen
    held = before.fitter.split.held_capture
    misfit = before.raw.square().mean((1, 2))
    number = int(torch.where(held, misfit, -1.0).argmax() if held.any() else misfit.argmax())
    with style():
        figure = Figure(figsize=(10.4, 3.1), layout="constrained")
        grid = figure.subplots(1, 3, sharey=True)
        recorded: Any = grid[0].imshow(seen.dn[number].numpy(), cmap="gray", vmin=0, interpolation="nearest")
        grid[0].set_ylabel(PLACE[1])
        pictures = [Picture("map", each.raw[number], axes=PLACE) for each in (before, after)]
        for axes, picture in zip(grid[1:], pictures, strict=True):
            residual: Any = draw_map(axes, picture, *limits(pictures))
            axes.label_outer()
        name = f"capture {int(seen.number[number])} ({seen.kinds[number]})"
        for axes, title in zip(grid, (name, "residual before", "residual after"), strict=True):
            axes.set_title(title, loc="left")
            axes.set_xlabel(PLACE[0])
            axes.spines[:].set_visible(False)
        figure.colorbar(recorded, ax=grid[0], shrink=0.85, label="DN").outline.set_visible(False)
        figure.colorbar(residual, ax=list(grid[1:]), shrink=0.85, label="residual (σ)").outline.set_visible(False)
        return figure


def histogram_figure(before: Residuals, after: Residuals) -> Figure:
    """Residuals against the standard normal that they follow when the model is right."""
    with style():
        figure = Figure(figsize=(5.4, 3.4), layout="constrained")
        axes = figure.subplots()
        edges = np.linspace(-8, 8, 81)
        middle = (edges[1:] + edges[:-1]) / 2
        least = 0.3 / before.raw.numel() / (edges[1] - edges[0])
        for each, colour, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
            count, _ = np.histogram(each.raw.clamp(-7.99, 7.99).numpy(), edges, density=True)
            axes.stairs(count.clip(least), edges, color=colour, linewidth=1.4, label=label, baseline=least)
        axes.plot(middle, np.exp(-(middle**2) / 2) / np.sqrt(2 * np.pi), "--", color=FAINT, label="standard normal")
        axes.set(yscale="log", ylim=(least, 1), xlabel="residual (σ; all beyond 8 at 8)", ylabel="density")
        axes.legend(loc="lower center")
        return figure


def evidence_figure(rounds: tuple[Round, ...], names: tuple[str, ...]) -> Figure:
    """What every round considered: nats that each candidate would gain at a glance, and in a joint fit.

    Args:
        rounds: of the search.
        names: effects that are in the model in the end.
    """
    with style():
        columns = min(2, max(1, len(rounds)))
        rows = max(1, -(-len(rounds) // columns))
        figure = Figure(figsize=(4.6 * columns + 0.4, 0.8 + 2.5 * rows), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for number, (axes, each) in enumerate(zip(grid, rounds, strict=False), start=1):
            gains = {name: max(gain, each.fitted.get(name, (0.0, 0.0))[0]) for name, gain in each.screened.items()}
            shown = sorted(gains, key=gains.__getitem__, reverse=True)[:SHOWN][::-1]
            place = np.arange(len(shown))
            screened = [max(each.screened[name], 0.1) for name in shown]
            fitted = [max(each.fitted.get(name, (0.0, 0.0))[0], 0.1) for name in shown]
            colours = [AFTER if name == each.added else FAINT for name in shown]
            axes.barh(place, fitted, height=0.62, color=colours, label="joint fit")
            axes.plot(screened, place, "|", color=BEFORE, markersize=9, markeredgewidth=1.6, label="at a glance")
            axes.set_yticks(place, shown)
            axes.set_xscale("log")
            axes.set_xlim(left=1)
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
            axes.tick_params(labelbottom=True)
            dropped = " (dropped later)" if each.added and each.added not in names else ""
            axes.set_title(f"round {number}: {each.added or 'nothing is worth its parameters'}{dropped}", loc="left")
        for axes in grid[len(rounds) :]:
            axes.set_axis_off()
        if len(rounds):
            figure.supxlabel("gain in log-likelihood (nats)", fontsize=9)
            figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8)
        return figure


def gap_figure(gaps: dict[str, dict[str, Any]]) -> Figure:
    """Reduced chi2 of every kind of capture, before and after."""
    kinds = list(gaps["before"]["by_kind"])[::-1]
    with style():
        figure = Figure(figsize=(5.4, 0.9 + 0.34 * (len(kinds) + 1)), layout="constrained")
        axes = figure.subplots()
        pairs = [(when["chi2"], then["chi2"]) for when, then in ((gaps["before"], gaps["after"]),)]
        pairs = [(gaps["before"]["by_kind"][k]["chi2"], gaps["after"]["by_kind"][k]["chi2"]) for k in kinds] + pairs
        for place, (before, after) in enumerate(pairs):
            axes.plot((before, after), (place, place), color=FAINT, linewidth=1, zorder=1)
        for values, colour, label in zip(zip(*pairs, strict=True), (BEFORE, AFTER), ("before", "after"), strict=True):
            axes.scatter(values, range(len(pairs)), s=34, color=colour, label=label, zorder=2)
        axes.axvline(1, color=FAINT, linewidth=0.8, linestyle="--")
        axes.set_yticks(range(len(pairs)), [*kinds, "all"])
        axes.set_xscale("log")
        low, high = min(min(pair) for pair in pairs), max(max(pair) for pair in pairs)
        axes.set_xlim(min(0.8, 0.9 * low), max(1.3, 1.2 * high))
        if high < 8:
            axes.xaxis.set_minor_locator(NullLocator())
            axes.set_xticks([tick for tick in (0.8, 1, 1.2, 1.5, 2, 3, 5) if tick <= max(1.3, 1.2 * high)])
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel("reduced chi2 on held-out pixels (1 = noise)")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        return figure


def correlation_figure(names: list[str], correlation: torch.Tensor) -> Figure:
    """How the parameters trade off against each other."""
    with style():
        side = 1.6 + 0.42 * len(names)
        figure = Figure(figsize=(side + 1.2, side), layout="constrained")
        axes = figure.subplots()
        others = correlation.clone().fill_diagonal_(math.nan)
        image = axes.imshow(others.numpy(), cmap="RdBu_r", vmin=-1, vmax=1)
        axes.set_xticks(range(len(names)), names, rotation=40, ha="right")
        axes.set_yticks(range(len(names)), names)
        axes.spines[:].set_visible(False)
        for row, column in ((r, c) for r in range(len(names)) for c in range(len(names)) if r != c):
            value = float(correlation[row, column])
            colour = "white" if abs(value) > 0.6 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8, color=colour)
        figure.colorbar(image, ax=axes, shrink=0.8, label="correlation").outline.set_visible(False)
        return figure


def chart_figure(values: torch.Tensor, unit: str) -> Figure:
    """An estimated map: an image, or a profile along rows or columns."""
    with style():
        if min(values.shape) == 1:
            figure = Figure(figsize=(6.4, 2.4), layout="constrained")
            axes = PLACE[values.shape[0] > 1], unit
            line = Picture("curve", values.flatten(), unit, tuple(map(float, range(values.numel()))), axes[:1])
            draw_test(figure, [line], [""], [AFTER])
        else:
            figure = Figure(figsize=(4.6, 3.6), layout="constrained")
            draw_test(figure, [Picture("map", values, unit, axes=PLACE)], [""], [AFTER])
        return figure


def unnamed_figure(unnamed: Unnamed) -> Figure:
    """What no name explains: how much of the signal it is, and where."""
    with style():
        figure = Figure(figsize=(5, 3.6 if unnamed.picture.ndim == 2 else 2.6), layout="constrained")
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
        axes.set_title(f"{unnamed.stage}: {unnamed.where}", loc="left")
        return figure


def test_figure(before: ResidualTest | None, after: ResidualTest) -> Figure:
    """A question's picture before and after; of a map that there was not before, after alone."""
    asked = [("before", BEFORE, before)] if before else []
    asked.append(("after", AFTER, after))
    names, colours, tests = zip(*asked, strict=True)
    with style():
        height = 2.5 if after.picture.kind == "map" else 2.1
        figure = Figure(figsize=(2.8 * len(tests) + 0.8, height), layout="constrained")
        draw_test(figure, [each.picture for each in tests], names, colours)
        return figure


def figures(found: Diagnosis) -> dict[str, Figure]:
    """The pictures that lie beside the report, by file name."""
    before, after = found.residuals["before"], found.residuals["after"]
    pictures = {
        "residuals.png": residuals_figure(before, after),
        "example.png": example_figure(before, after),
        "histogram.png": histogram_figure(before, after),
        "gap.png": gap_figure(found.gaps),
        "evidence.png": evidence_figure(found.rounds, found.names),
    }
    return pictures | {f"unnamed_{n}.png": unnamed_figure(each) for n, each in enumerate(found.unnamed, start=1)}
