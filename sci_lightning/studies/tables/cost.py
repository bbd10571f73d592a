"""What decoding costs: parameters and operations of the full networks, and the figure of quality against cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sci_lightning.plain_text import in_figure
from sci_lightning.studies.tables.line import Line, lines_of
from sci_lightning.studies.tables.run import ScoredRun

MOST_PANELS = 8
"""Settings of ours that are drawn, in the order of the lines; the tables hold all."""
AREA = 700.0
"""Of the circle of a panel's largest network, in square points; the others' go with their parameters."""
PANEL = (320.0, 260.0)
"""Width and height of a panel's axes, roughly, in points."""
MARGIN = 0.25
"""Room beside the outermost circles, as a part of what lies between them."""
FONT = 7.0

PAPER_CLIPS = 100 * 24_500
"""Clips of 256 x 256 that the paper's trainings see: 100 epochs of all groups of eight frames of DAVIS 2017."""

Box = tuple[float, float, float, float]
"""Left, bottom, right, top, in points."""


@dataclass(frozen=True)
class Cost:
    """What a decoder costs at 256 x 256, T = 8.

    Attributes:
        paper: the paper's figures, ``parameters_M``, ``macs_G`` and ``seconds``.
        parameters, macs: ours, None of a decoder that is not in ``conf/decoder``.
    """

    paper: Mapping[str, float]
    parameters: int | None = None
    macs: int | None = None


def costs(paper: Mapping[str, Mapping[str, Any]], decoders: Mapping[str, Mapping[str, Any]]) -> dict[str, Cost]:
    """Count the parameters and operations of each decoder that the paper lists; no memory is taken for its weights.

    Args:
        paper: ``decoders`` of ``paper_figures.yaml``.
        decoders: ours by name: plain configurations for T = 8.
    """
    return {name: _cost(name, figures, decoders.get(name)) for name, figures in paper.items()}


def _cost(name: str, figures: Mapping[str, Any], config: Mapping[str, Any] | None) -> Cost:
    import torch

    from sci_lightning.configuration.build import build
    from sci_lightning.decoder.complexity import count_as_paper, count_parameters

    if config is None:
        return Cost(figures)
    with torch.device("meta"):
        decoder = build(config, f"decoder={name}")
    return Cost(figures, count_parameters(decoder), count_as_paper(decoder, 8, 256, 256, figures["macs_rules"]))


def share_of_paper(run: ScoredRun, macs: float) -> float | None:
    """Return what a training computed as a part of what the paper's training of that network does; None if not known.

    Args:
        run: ours.
        macs: multiply-accumulates of the network as published, for one measurement of 256 x 256, T = 8.
    """
    return None if run.computation is None else run.computation / (6.0 * macs * PAPER_CLIPS)


def cost_figure(table: Mapping[str, Any], runs: Sequence[ScoredRun], paper: Mapping[str, Mapping[str, Any]]) -> Figure:
    """PSNR over multiply-accumulates, circles as large as the parameters, as the paper draws it.

    There is a panel of the paper's own figures, and one for each setting of our runs, whose networks count as they ran.

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
    """Circles coloured by column; each network's name once, with its parameters, beside its best."""
    largest = max(point.parameters for point in points)
    for point in points:
        area = AREA * point.parameters / largest
        axes.scatter([point.macs], [point.psnr], s=area, color=f"C{columns.index(point.column)}", alpha=0.6)
    axes.set(xscale="log", xlabel="multiply-accumulates (G)", ylabel="PSNR (dB)")
    axes.margins(MARGIN)
    axes.grid(alpha=0.3)
    best = {point.row: point for point in sorted(points, key=lambda point: point.psnr)}
    for row, (text, (x, y)) in _places(points, best, largest).items():
        side: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": FONT}
        axes.annotate(text, (best[row].macs, best[row].psnr), (x, y), textcoords="offset points", **side)
    handles = [axes.scatter([], [], color=f"C{number}", alpha=0.6) for number in range(len(columns))]
    axes.legend(handles, columns, fontsize=8, loc="lower right")


def _places(
    points: Sequence[Point], best: Mapping[str, Point], largest: float
) -> dict[str, tuple[str, tuple[float, float]]]:
    """Each network's label and where its middle lies from its circle's, in points: where it covers the least.

    Left and right of the circle come before above and below, where a label may be taken for that of another circle.
    """
    x, y = (
        _spread([math.log10(point.macs) for point in points], PANEL[0]),
        _spread([point.psnr for point in points], PANEL[1]),
    )
    radius = [(AREA * point.parameters / largest) ** 0.5 / 2 for point in points]
    taken = [(a - r, b - r, a + r, b + r) for a, b, r in zip(x, y, radius, strict=True)]
    content = {}
    for row, point in best.items():
        text = f"{in_figure(row)}, {point.parameters:.3g} M"
        number = next(number for number, other in enumerate(points) if other is point)
        width, height, away = 0.56 * FONT * len(text), 1.3 * FONT, radius[number] + 2
        across, up = away + width / 2, away + height / 2
        middles = [(-across, 0.0), (across, 0.0), (0.0, up), (0.0, -up)]
        boxes = [
            (
                x[number] + a - width / 2,
                y[number] + b - height / 2,
                x[number] + a + width / 2,
                y[number] + b + height / 2,
            )
            for a, b in middles
        ]
        covered = [sum(_overlap(box, other) for other in taken) + _beyond(box) for box in boxes]
        chosen = covered.index(min(covered))
        taken.append(boxes[chosen])
        content[row] = text, middles[chosen]
    return content


def _spread(values: Sequence[float], length: float) -> list[float]:
    """Where values come to lie on an axis of that length with margins."""
    low, high = min(values), max(values)
    span = (high - low) * (1 + 2 * MARGIN) or 1.0
    return [length * ((value - (low + high) / 2) / span + 0.5) for value in values]


def _overlap(one: Box, other: Box) -> float:
    """The area that two boxes share."""
    return max(0.0, min(one[2], other[2]) - max(one[0], other[0])) * max(
        0.0, min(one[3], other[3]) - max(one[1], other[1])
    )


def _beyond(box: Box) -> float:
    """The area of a box that lies outside of the panel."""
    return (box[2] - box[0]) * (box[3] - box[1]) - _overlap(box, (0.0, 0.0, *PANEL))
