"""The paper's figure of quality against cost: PSNR over multiply-accumulates, circles as large as the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sci_lightning.paper_tables.line import Line, lines_of
from sci_lightning.paper_tables.run import Run

AREA = 30.0
"""Of a circle, in square points, per million parameters."""


def cost_figure(table: Mapping[str, Any], runs: Sequence[Run], paper: Mapping[str, Mapping[str, Any]]) -> Figure:
    """A panel of the paper's own figures, and one for each setting of our runs, whose networks count as they ran.

    Args:
        table: of ``paper_figures.yaml``; a circle for each of its rows and columns.
        runs: ours.
        paper: ``decoders`` of ``paper_figures.yaml``.
    """
    lines = lines_of(table, runs)
    settings = list(dict.fromkeys(str(line.runs[0].setting) for line in lines if line.runs))
    figure = Figure(figsize=(5.2 * (1 + len(settings)), 4.4), layout="constrained")
    first, *others = figure.subplots(1, 1 + len(settings), squeeze=False)[0]
    first.set_title("the paper: 256 x 256", fontsize=10)
    for line in {(line.row, line.column): line for line in lines}.values():
        cost = paper[line.decoder]
        _circle(first, table, line, cost["macs_G"], line.paper["psnr"], cost["parameters_M"])
    for axes, setting in zip(others, settings, strict=True):
        axes.set_title(f"ours, {setting}", fontsize=10)
        for line in lines:
            if line.runs and str(line.runs[0].setting) == setting:
                run = line.runs[0]
                _circle(axes, table, line, run.macs / 1e9, line.mean()["psnr"], run.parameters / 1e6)
    for axes in (first, *others):
        axes.set(xscale="log", xlabel="multiply-accumulates (G)", ylabel="PSNR (dB)")
        axes.margins(0.25)
        axes.grid(alpha=0.3)
        handles = [axes.scatter([], [], color=f"C{number}", alpha=0.6) for number in range(len(table["columns"]))]
        axes.legend(handles, list(table["columns"]), fontsize=8, loc="lower right")
    return figure


def _circle(axes: Axes, table: Mapping[str, Any], line: Line, macs: float, psnr: float, parameters: float) -> None:
    """One network; the number beside its name is of its parameters, in millions."""
    colour = f"C{list(table['columns']).index(line.column)}"
    axes.scatter([macs], [psnr], s=AREA * parameters + 8, color=colour, alpha=0.6)
    axes.annotate(f"{line.row} ({parameters:.3g} M)", (macs, psnr), fontsize=7, ha="center", va="center")
