"""A designed mask as files and as a picture: the tile, its autocorrelation, its spectrum and its levels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from scipy.io import savemat

from sci_lightning.figures.figure import show_picture
from sci_lightning.files.atomic_file import atomic_write

MOST_SLOTS = 16
"""Of masks with more slots, so many are drawn."""


def write_mask(mask: torch.Tensor, folder: str | Path) -> None:
    """Write a mask ``(T, H, W)`` as ``mask.npy`` and, as MATLAB's ``(H, W, T)``, as ``mask`` in ``mask.mat``."""
    folder = Path(folder)
    values = mask.numpy().astype(np.float32)
    with atomic_write(folder / "mask.npy") as temporary, temporary.open("wb") as stream:
        np.save(stream, values)
    with atomic_write(folder / "mask.mat") as temporary, temporary.open("wb") as stream:
        savemat(stream, {"mask": values.transpose(1, 2, 0)}, do_compression=True)


def design_figure(mask: torch.Tensor, tile: tuple[int, int], bits: int, title: str = "") -> Figure:
    """Draw the slots of the tile, the mask's spatial autocorrelation and spectrum, that in time, and its levels.

    Args:
        mask: ``(T, H, W)`` in [0, 1].
        tile: (h, w) that is repeated.
        bits: bit depth of its levels.
        title: heading.
    """
    values = mask.numpy()
    shown = values[:MOST_SLOTS]
    figure = Figure(figsize=(max(8.0, 1.3 * len(shown)), 5.4), layout="constrained")
    figure.suptitle(title)
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1, 1.6])[:, 0]
    brightest = max(float(values.max()), 1e-6)
    for slot, axes in enumerate(top.subplots(1, len(shown), squeeze=False)[0]):
        show_picture(axes, shown[slot, : tile[0], : tile[1]], f"slot {slot + 1}", high=brightest)
    deviation = values - values.mean((1, 2), keepdims=True)
    spectrum = np.abs(np.fft.fft2(deviation)) ** 2
    autocorrelation = np.fft.fftshift(np.fft.ifft2(spectrum.mean(0)).real)
    autocorrelation /= max(float(autocorrelation.max()), 1e-12)
    in_time = np.einsum("thw,shw->ts", deviation, deviation)
    in_time /= max(float(in_time.max()), 1e-12)
    places = bottom.subplots(1, 4)
    (height, width), reach = autocorrelation.shape, 12
    middle = autocorrelation[
        max(0, height // 2 - reach) : height // 2 + reach + 1, max(0, width // 2 - reach) : width // 2 + reach + 1
    ]
    power = np.fft.fftshift(np.log10(spectrum.mean(0) + 1e-9))
    pictures = (
        (middle, "autocorrelation", -1.0, 1.0),
        (power, "log spectrum", float(power.max()) - 4, float(power.max())),
        (in_time, "slot by slot", -1.0, 1.0),
    )
    for axes, (picture, name, low, high) in zip(places[:3], pictures, strict=True):
        axes.imshow(
            picture, cmap="RdBu_r" if low < 0 < high else "viridis", vmin=low, vmax=high, interpolation="nearest"
        )
        axes.set_title(name, fontsize=10)
        axes.set_axis_off()
    steps = 2**bits if bits > 1 else 1
    count = np.bincount(np.rint(values.ravel() * steps).astype(int), minlength=steps + 1) / values.size
    places[3].bar(np.arange(steps + 1) / steps, 100 * count, width=0.8 / steps, color="#30678d")
    places[3].set(xlabel="transmittance", ylabel="share of values (%)", title="levels")
    return figure
