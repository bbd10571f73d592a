"""A contact sheet: one picture with a thumbnail of every capture, for a lab book or a talk."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from sci_lightning.captures.captures import Captures
from sci_lightning.files.atomic_file import atomic_write

MOST = 60
"""Largest number of thumbnails; of more captures, an even selection of every kind is shown."""
COLUMNS = 10
PIXELS = 150
"""Larger images are binned to about this side."""
DIM = 0.1
"""Part of the range; the contrast of captures that stay below it is stretched."""
RED = (0.9, 0.1, 0.1)
COLOURS = {
    "dark": "#444444",
    "flat": "#c98a00",
    "pattern": "#7a4fa3",
    "static": "#1f6fb2",
    "dynamic": "#1e8a4c",
    "unknown": "#b0488c",
}


def contact_sheet(path: str | Path, captures: Captures) -> int:
    """Write a PNG of the first patterns and of every capture's measurement.

    Black is 0 and white full scale, except for dark captures and others that use less than a tenth of the range: these
    are stretched, each to the DN below it. Saturated pixels are red.

    Args:
        path: the PNG; it is written whole or not at all.
        captures: what to draw.

    Returns:
        The number of captures that are left out because there are more than :data:`MOST`.
    """
    figure = contact_sheet_figure(captures)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120, format="png")
    return max(0, len(captures) - MOST)


def contact_sheet_figure(captures: Captures) -> Figure:
    """Return the figure that :func:`contact_sheet` writes."""
    shown = selected(captures.kind)
    columns = COLUMNS if len(shown) > 24 else max(6, min(8, len(shown)))
    rows = math.ceil(len(shown) / columns)
    tall = min(max(captures.size[0] / captures.size[1], 0.4), 2.5)
    # inches: a thumbnail with its label, and the title, the row of patterns and the legend
    top, row = 1.35 * tall + 0.45, 1.35 * tall + 0.66
    figure = Figure(figsize=(1.45 * columns, 0.6 + top + rows * row + 0.45), layout="constrained")
    figure.suptitle(_title(captures), fontsize=11)
    upper, lower, legend = figure.subfigures(3, 1, squeeze=False, height_ratios=[top, rows * row, 0.45])[:, 0]
    for number, axes in enumerate(upper.subplots(1, columns, squeeze=False)[0]):
        axes.set_axis_off()
        if number < len(captures.patterns):
            pattern = _binned(captures.patterns[number])
            axes.imshow(pattern, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
            _frame(axes, pattern.shape, "#999999", 0.8)
            more = f" of {len(captures.patterns)}" if number == columns - 1 < len(captures.patterns) - 1 else ""
            axes.set_title(f"pattern {number}{more}", fontsize=8)
    grid = lower.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, index in zip(grid, shown, strict=False):
        _thumbnail(axes, captures, index)
    kinds = [Patch(color=COLOURS[kind], label=kind) for kind in COLOURS if kind in captures.kind]
    saturated = Patch(color=RED, label=f"saturated (at {captures.full_scale} DN)")
    legend.legend(handles=[*kinds, saturated], loc="center", ncols=7, fontsize=8, frameon=False)
    return figure


def selected(kind: tuple[str, ...]) -> list[int]:
    """Return the numbers of at most :data:`MOST` captures, in order: as many of every kind, evenly spread over it."""
    groups = [[index for index, label in enumerate(kind) if label == name] for name in dict.fromkeys(kind)]
    share = [0] * len(groups)
    for _ in range(min(MOST, len(kind))):
        unfinished = [number for number, group in enumerate(groups) if share[number] < len(group)]
        share[min(unfinished, key=lambda number: share[number])] += 1
    picked = [
        group[round(index)]
        for group, count in zip(groups, share, strict=True)
        for index in np.linspace(0, len(group) - 1, count)
    ]
    return sorted(picked)


def _title(captures: Captures) -> str:
    height, width = captures.size
    left_out = len(captures) - MOST
    shown = f" ({MOST} shown, {left_out} left out)" if left_out > 0 else ""
    name = captures.name if len(captures.name) <= 40 else captures.name[:39] + "…"
    name = name.replace("$", r"\$")  # no formula
    return (
        f"{name}: {len(captures)} captures{shown} of {height} x {width}, {captures.frames} slots, "
        f"{captures.bit_depth} bits"
    )


def _thumbnail(axes: Axes, captures: Captures, index: int) -> None:
    raw = captures.measurement[index]
    image = _binned(raw)
    # hot pixels, even one in a hundred, must not hide what they stand in
    low, high = (float(np.percentile(raw, part)) for part in (1, 98))
    dim = captures.kind[index] == "dark" or high < DIM * captures.full_scale
    if dim:
        low, high = math.floor(low), max(math.ceil(high), math.floor(low) + 1)
    else:
        low, high = 0, captures.full_scale
    grey = np.clip((image - low) / (high - low), 0, 1)
    colour = np.repeat(grey[:, :, None], 3, 2)
    red = np.sqrt(_binned(raw >= captures.full_scale))[:, :, None]  # a single pixel of a block can still be seen
    colour = (1 - red) * colour + red * np.array(RED)
    axes.imshow(colour, interpolation="nearest")
    _frame(axes, colour.shape, COLOURS[captures.kind[index]], 2.5)
    mean = raw.mean()
    axes.set_title(f"{index} {captures.kind[index]}\nmean {mean:.{0 if mean >= 100 else 1}f} DN", fontsize=8, pad=4)
    scales = ((name, float(getattr(captures, name)[index])) for name in ("aperture", "exposure"))
    notes = [f"{name} {value:.3g}" for name, value in scales if value != 1]
    if dim:
        notes.append(f"stretched: {low:g} to {high:g} DN")
    below: dict[str, Any] = {"xycoords": "axes fraction", "xytext": (0, -4), "textcoords": "offset points"}
    axes.annotate("\n".join(notes), (0.5, 0), ha="center", va="top", fontsize=7, **below)


def _frame(axes: Axes, shape: tuple[int, ...], colour: str, width: float) -> None:
    axes.add_patch(
        Rectangle((-0.5, -0.5), shape[1], shape[0], fill=False, edgecolor=colour, linewidth=width, clip_on=False)
    )


def _binned(image: np.ndarray) -> np.ndarray:
    """Return the image as float32, a large one averaged over blocks; skipping pixels would show false patterns."""
    step = max(1, math.ceil(max(image.shape) / PIXELS))
    height, width = (max(1, side // step) * step for side in image.shape)
    cut = image[:height, :width].astype(np.float32)
    if step == 1 or min(image.shape) < step:
        return image.astype(np.float32)
    return cut.reshape(height // step, step, width // step, step).mean((1, 3))
