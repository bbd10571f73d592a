"""The paper's figure of quality against cost: PSNR over multiply-accumulates, circles as large as the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sci_lightning.paper_tables.line import Line, lines_of
from sci_lightning.paper_tables.run import Run
from sci_lightning.plain_text import in_figure

MOST_PANELS = 8
"""Settings of ours that are drawn, in the order of the lines; the tables hold all."""
AREA = 700.0
"""Of the circle of a panel's largest network, in square points; the others' go with their parameters."""


def cost_figure(table: Mapping[str, Any], runs: Sequence[Run], paper: Mapping[str, Mapping[str, Any]]) -> Figure:
    """A panel of the paper's own figures, and one for each setting of our runs, whose networks count as they ran.

    Args:
        table: of ``paper_figures.yaml``; a circle for each of its rows and columns.
        runs: ours.
        paper: ``decoders`` of ``paper_figures.yaml``.
    """
    lines = lines_of(table, runs)
    papers = {(line.row, line.column): line for line in lines}.values()
    panels = {"the paper: 256 x 256": [_paper_point(line, paper[line.decoder]) for line in papers]}
    for line in lines:
        if line.runs and "psnr" in line.mean() and line.runs[0].macs and line.runs[0].parameters:
            title = f"ours, {line.runs[0].setting}"
            if title in panels or len(panels) <= MOST_PANELS:
                panels.setdefault(title, []).append(_point(line))
    figure = Figure(figsize=(5.2 * len(panels), 4.4), layout="constrained")
    for axes, (title, points) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        axes.set_title(in_figure(title, 60), fontsize=10)
        _draw(axes, points, list(table["columns"]))
    return figure


@dataclass(frozen=True)
class Point:
    """A network in the figure: ``macs`` in G, ``psnr`` in dB, ``parameters`` in millions."""

    row: str
    column: str
    macs: float
    psnr: float
    parameters: float


def _paper_point(line: Line, cost: Mapping[str, Any]) -> Point:
    return Point(line.row, line.column, cost["macs_G"], line.paper["psnr"], cost["parameters_M"])


def _point(line: Line) -> Point:
    run = line.runs[0]
    return Point(line.row, line.column, run.macs / 1e9, line.mean()["psnr"], run.parameters / 1e6)


def _draw(axes: Axes, points: Sequence[Point], columns: Sequence[str]) -> None:
    """Circles coloured by column; each network's name once, with its parameters: above its best, in a crowd below."""
    largest = max(point.parameters for point in points)
    span = max(point.psnr for point in points) - min(point.psnr for point in points)
    best = {point.row: point for point in sorted(points, key=lambda point: point.psnr)}
    for point in points:
        area = AREA * point.parameters / largest
        colour = f"C{columns.index(point.column)}"
        axes.scatter([point.macs], [point.psnr], s=area, color=colour, alpha=0.6)
        if best[point.row] is point:
            label = f"{in_figure(point.row)}, {point.parameters:.3g} M"
            over = (other for other in best.values() if 0 < other.psnr - point.psnr < 0.06 * span)
            below = any(0.3 < other.macs / point.macs < 3 for other in over)
            away = (0, (-1 if below else 1) * (area**0.5 / 2 + 2))
            side: dict[str, Any] = {"ha": "center", "va": "top" if below else "bottom"}
            axes.annotate(label, (point.macs, point.psnr), away, textcoords="offset points", fontsize=7, **side)
    axes.set(xscale="log", xlabel="multiply-accumulates (G)", ylabel="PSNR (dB)")
    axes.margins(0.25)
    axes.grid(alpha=0.3)
    handles = [axes.scatter([], [], color=f"C{number}", alpha=0.6) for number in range(len(columns))]
    axes.legend(handles, columns, fontsize=8, loc="lower right")
