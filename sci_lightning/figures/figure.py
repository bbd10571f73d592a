"""Figures of masks, measurements and reconstructions, for dashboards and run folders."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.plain_text import in_figure

MAX_FRAMES = 8
"""Of longer videos, so many frames are shown at equal distances."""


def mask_figure(mask: torch.Tensor, bits: int | None = None, title: str = "") -> Figure:
    """Draw the slots of a mask side by side, a close-up, its sum over time, and the histogram of its levels.

    Args:
        mask: ``(T, H, W)`` in [0, 1].
        bits: bit depth of its levels; None for two levels.
        title: heading, such as the encoder and the step.
    """
    slots = _shown_frames(mask, MAX_FRAMES)
    values = _values(mask)
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


def pair_figure(left: tuple[str, torch.Tensor], right: tuple[str, torch.Tensor], title: str = "") -> Figure:
    """Draw two images as large as the card of a dashboard shows them, which is some 380 x 220 pixels.

    Args:
        left, right: what stands above each, and the image ``(H, W)``, white at 1.0 or the brightest pixel of both.
        title: heading.
    """
    figure = Figure(figsize=(4.0, 2.35), layout="constrained")
    figure.suptitle(in_figure(title), fontsize=9)
    images = [_values(image) for _, image in (left, right)]
    for axes, (above, _), image in zip(figure.subplots(1, 2), (left, right), images, strict=True):
        show_picture(axes, image, above, high=max(1.0, *(one.max() for one in images)))
    return figure


def reconstruction_figure(
    measurement: torch.Tensor,
    truth: torch.Tensor | None,
    estimate: torch.Tensor | None,
    title: str = "",
    most: int = MAX_FRAMES,
) -> Figure:
    """Draw one snapshot: the measurement, then in every column a frame, its reconstruction and the error.

    Args:
        measurement: ``(H, W)``; truth, estimate: ``(T, H, W)``, in colour ``(3, T, H, W)``; all with white at 1.0.
            Without ``truth`` or ``estimate`` the rows that need it are left out.
        title: heading, such as the scene's name.
        most: frames that are shown; the figure is as wide as they need.
    """
    m = _values(measurement)
    truth, estimate = (
        video.movedim(0, -1) if video is not None and video.ndim == 4 else video for video in (truth, estimate)
    )
    y, x = (None if video is None else _values(video) for video in (truth, estimate))
    rows: dict[str, tuple[np.ndarray, list[str], str]] = {}
    shown = _shown_frames(next(video for video in (truth, estimate) if video is not None), most)
    numbers = [f"{frame + 1}" for frame in shown]
    if y is not None:
        rows["frame"] = y, numbers, "gray"
    if x is not None:
        rows["reconstruction"] = x, numbers if y is None else [f"{_psnr(x[i], y[i]):.1f} dB" for i in shown], "gray"
    if x is not None and y is not None:
        error = np.abs(x - y)
        rows["error x 5"] = 5 * (error.mean(-1) if error.ndim == 4 else error), [""] * len(shown), "magma"
    figure = NotebookFigure(figsize=(1.55 * (len(shown) + 1), 1.65 * len(rows) + 0.25), layout="constrained")
    figure.suptitle(in_figure(title))
    grid = figure.subplots(len(rows), len(shown) + 1, squeeze=False)
    show_picture(grid[0, 0], m, "measurement", high=max(1.0, m.max()))
    for axes in grid[1:, 0]:
        axes.set_axis_off()
    for line, (label, (video, titles, colours)) in zip(grid[:, 1:], rows.items(), strict=True):
        line[0].text(-0.06, 0.5, label, transform=line[0].transAxes, rotation=90, va="center", ha="right", fontsize=9)
        for axes, frame, above in zip(line, shown, titles, strict=True):
            show_picture(axes, video[frame], above, colours=colours)
    return figure


def plot(
    measurement: torch.Tensor,
    video: torch.Tensor | None = None,
    estimate: torch.Tensor | None = None,
    *,
    title: str = "",
    frames: int = MAX_FRAMES,
) -> Figure:
    """Draw a snapshot, its frames and their reconstruction with the PSNR of every frame, to be looked at in a notebook.

    >>> import torch
    >>> import sci_lightning as sci
    >>> video = torch.rand(1, 8, 16, 16)
    >>> figure = sci.plot(video.mean(1), video, video.sqrt(), title="noise")
    >>> figure.savefig("noise.png")

    Args:
        measurement: ``(H, W)`` or a batch ``(N, H, W)``, of which the first snapshot is drawn; white is 1.0 or the
            brightest pixel beyond it.
        video: ``(T, H, W)`` or ``(N, T, H, W)``, the frames as they were, white at 1.0; None if nobody knows them.
        estimate: the reconstruction, of the same shape; None for none.
        title: heading, such as the scene's name.
        frames: how many frames are drawn at most, at equal distances in time.

    Returns:
        a matplotlib figure: a notebook shows it, ``figure.savefig(FILE)`` writes it.

    Raises:
        BadInput: neither frames nor estimate, or shapes that do not belong together.
    """
    given = (("measurement", measurement, 2), ("video", video, 3), ("estimate", estimate, 3))
    tensors = {name: torch.as_tensor(value) for name, value, _ in given if value is not None}
    first = {
        name: tensors[name][0] if tensors[name].ndim == axes + 1 else tensors[name]
        for name, _, axes in given
        if name in tensors
    }
    shapes = {name: tuple(tensor.shape) for name, tensor in first.items()}
    snapshot = shapes.pop("measurement")
    if len(set(shapes.values())) != 1 or len(snapshot) != 2 or next(iter(shapes.values()))[1:] != snapshot:
        named = ", ".join(f"{name} {tuple(tensor.shape)}" for name, tensor in tensors.items())
        raise BadInput(
            f"{named}: expected a measurement (H, W) or (N, H, W), and of the same size the video (T, H, W) or "
            "(N, T, H, W), the estimate, or both"
        )
    if frames < 1:
        raise BadInput(f"frames={frames}: at least one frame must be drawn")
    return reconstruction_figure(first["measurement"], first.get("video"), first.get("estimate"), title, frames)


class NotebookFigure(Figure):
    """A figure that a notebook shows although matplotlib's pyplot, which would tell it how, was never imported."""

    def _repr_png_(self) -> bytes:
        with io.BytesIO() as file:
            self.savefig(file, format="png", dpi=110)
            return file.getvalue()


def _values(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().float().cpu().numpy()


def _psnr(estimate: np.ndarray, truth: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(np.mean((estimate - truth) ** 2)), 1e-10)))


def _shown_frames(video: torch.Tensor, most: int) -> list[int]:
    """Return the numbers of at most ``most`` frames at equal distances."""
    count = min(len(video), most)
    return [int(index) for index in np.linspace(0, len(video) - 1, count).round()]


def show_picture(axes: Axes, image: np.ndarray, title: str, high: float = 1.0, colours: str = "gray") -> None:
    """Draw an image ``(H, W)`` from 0 (black) to ``high``, or ``(H, W, 3)`` to 1, under a title, not interpolated."""
    shown = image.clip(0, 1) if image.ndim == 3 else image
    axes.imshow(shown, cmap=colours, vmin=0, vmax=high, interpolation="nearest")
    axes.set_title(in_figure(title), fontsize=10)
    axes.set(xticks=[], yticks=[])  # hidden ones would take time
    axes.set_axis_off()


def write_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG without margins; an existing file is replaced only by a complete one."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=150, bbox_inches="tight")
