"""Figures of masks, measurements and reconstructions, for dashboards and run folders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.plain_text import in_figure

MAX_FRAMES = 8
"""Of longer videos, so many frames are shown at equal distances."""


def mask_figure(mask: torch.Tensor, bits: int | None = None, title: str = "") -> Figure:
    """Draw the slots of a mask side by side, a close-up, its sum over time, and the histogram of its levels.

    Args:
        mask: ``(T, H, W)`` in [0, 1].
        bits: bit depth of its levels; None for two levels.
        title: heading, such as the encoder and the step.
    """
    slots = _shown_frames(mask)
    values = mask.detach().float().cpu().numpy()
    levels = 2**bits if bits else 2
    figure = Figure(figsize=(1.55 * len(slots), 5.6), layout="constrained")
    figure.suptitle(title)
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1, 1.5])[:, 0]
    brightest = max(values.max(), 1e-6)
    for axes, slot in zip(top.subplots(1, len(slots), squeeze=False)[0], slots, strict=True):
        show_picture(axes, values[slot], f"slot {slot + 1}", high=brightest)
    close, sums, histogram = bottom.subplots(1, 3, width_ratios=[1, 1, 1.6])
    show_picture(close, values[0, :24, :24], "slot 1, 24 x 24 corner", high=brightest)
    total = values.sum(0)
    image = sums.imshow(total, cmap="viridis", vmin=min(total.min(), 0.999), vmax=max(total.max(), 1.001))
    sums.set_title("sum over time")
    sums.set_axis_off()
    figure.colorbar(image, ax=sums, shrink=0.7)
    steps = levels if levels > 2 else 1
    count = np.bincount(np.rint(values.ravel() * steps).astype(int), minlength=steps + 1) / values.size
    histogram.bar(np.arange(steps + 1) / steps, 100 * count, width=0.8 / steps, color="#30678d")
    histogram.set(xlabel="transmittance", ylabel="share of values (%)", title="levels")
    return figure


def reconstruction_figure(
    measurement: torch.Tensor, truth: torch.Tensor, estimate: torch.Tensor, title: str = ""
) -> Figure:
    """Draw one snapshot: the measurement, then in every column a frame, its reconstruction and the error.

    Args:
        measurement: ``(H, W)``; truth, estimate: ``(T, H, W)``; all with white at 1.0.
        title: heading, such as the scene's name.
    """
    shown = _shown_frames(truth)
    x, y, m = (v.detach().float().cpu().numpy() for v in (estimate, truth, measurement))
    error = np.abs(x - y)
    figure = Figure(figsize=(1.55 * (len(shown) + 1), 5.2), layout="constrained")
    figure.suptitle(in_figure(title))
    grid = figure.subplots(3, len(shown) + 1, squeeze=False)
    show_picture(grid[0, 0], m, "measurement", high=max(1.0, m.max()))
    for axes in grid[1:, 0]:
        axes.set_axis_off()
    for label, axes in zip(("frame", "reconstruction", "error x 5"), grid[:, 1], strict=True):
        axes.text(-0.06, 0.5, label, transform=axes.transAxes, rotation=90, va="center", ha="right", fontsize=9)
    for column, frame in enumerate(shown, start=1):
        psnr = -10 * np.log10(max(float(np.mean((x[frame] - y[frame]) ** 2)), 1e-10))
        show_picture(grid[0, column], y[frame], f"{frame + 1}")
        show_picture(grid[1, column], x[frame], f"{psnr:.1f} dB")
        show_picture(grid[2, column], 5 * error[frame], "", colours="magma")
    return figure


def _shown_frames(video: torch.Tensor) -> list[int]:
    """Return the numbers of at most ``MAX_FRAMES`` frames at equal distances."""
    count = min(len(video), MAX_FRAMES)
    return [int(index) for index in np.linspace(0, len(video) - 1, count).round()]


def show_picture(axes: Axes, image: np.ndarray, title: str, high: float = 1.0, colours: str = "gray") -> None:
    """Draw an image ``(H, W)`` from 0 (black) to ``high`` under a title, without interpolation."""
    axes.imshow(image, cmap=colours, vmin=0, vmax=high, interpolation="nearest")
    axes.set_title(in_figure(title), fontsize=10)
    axes.set(xticks=[], yticks=[])  # hidden ones would take time
    axes.set_axis_off()


def write_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG without margins; an existing file is replaced only by a complete one."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=150, bbox_inches="tight")
