"""How much of a sensor's range real snapshots use, and how much of their detail is the mask's: no mask is needed.

``python -m tests.studies.figures.capture_range OUT FOLDER FOLDER ..`` writes OUT/capture_range.json and .png.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sci_lightning.captures.light_scale import raw_dn
from sci_lightning.errors import BadInput
from sci_lightning.figures.figure import show_picture, write_figure
from sci_lightning.files.picture_file import natural, pictures_of, read_pictures
from sci_lightning.plain_text import in_figure, in_markdown
from tests.measurements_file import Column, MeasurementsFile

RIM = (3, 4)
"""Rows at the top and bottom, and columns at the left and right, that are left out, as in the released code of the
paper: its modulator does not reach there."""

FINE = 1 / 8
"""Cycles a pixel from which detail counts as fine."""

BRIGHT = 99.9
"""Percentile that stands for a snapshot's bright end; the few pixels above it may be defects."""

CLOSE_UP = 96
"""Side of the part that is shown enlarged, pixels."""

COLUMNS: list[Column] = [
    ("snapshot", "snapshot", None),
    ("mask", "folder", None),
    ("levels", "levels used", 0),
    ("bright", f"{BRIGHT} % of the pixels are below (DN)", 0),
    ("mean", "mean (DN)", 1),
    ("white", "at full scale (%)", 2),
    ("black", "at 0 (%)", 2),
    ("fine", "share of fine detail", 3),
]


def capture_range(out: Path, folders: Sequence[str | Path]) -> None:
    """Compare snapshots of the same scenes behind different masks, the paper's Figure 3 (d, e) and its range claim.

    Args:
        out: folder of what is written.
        folders: one for each mask, of pictures of raw DN; those of one name in all folders show the same scene.

    Raises:
        BadInput: a file that is unreadable or no snapshot of 8 bits, or no name that all folders have.
    """
    named = [{Path(file).stem: file for file in pictures_of(folder)} for folder in folders]
    common = sorted(set.intersection(*(set(files) for files in named)), key=natural)
    if not common:
        raise BadInput(f"{', '.join(map(str, folders))}: no picture has the same name in all of these folders")
    snapshots = {
        Path(folder).name: {name: _snapshot(files[name]) for name in common}
        for folder, files in zip(folders, named, strict=True)
    }
    rows = [
        {"snapshot": in_markdown(name), "mask": in_markdown(mask), **range_of(snapshots[mask][name])}
        for name in common
        for mask in snapshots
    ]
    notes = [
        f"Fine detail: the share of a snapshot's variance at {FINE:g} cycles a pixel and above (Hann window). "
        "The scenes moved between the captures, and the exposure of each is not known.",
    ]
    command = f"python -m tests.studies.figures.capture_range OUT {' '.join(snapshots)}"
    file = MeasurementsFile(
        out / "capture_range.json", machine="computed", scale="real snapshots", seeds="none", command=command
    )
    file.write(COLUMNS, rows, notes)
    write_figure(_figure(snapshots, common[0]), out / "capture_range.png")


def _snapshot(file: str) -> np.ndarray:
    """Return the DN of a picture without its rim, ``(H, W)``."""
    dn, bit_depth = raw_dn(read_pictures(file, prefer="measurement")[None], file)
    if bit_depth != 8 or dn.ndim != 3 or min(dn.shape[1:]) < CLOSE_UP + 2 * max(RIM):
        raise BadInput(f"{file}: expected one snapshot of 8 bits, at least {CLOSE_UP + 2 * max(RIM)} pixels a side")
    return dn[0, RIM[0] : -RIM[0], RIM[1] : -RIM[1]]


def range_of(dn: np.ndarray) -> dict[str, Any]:
    """Return the figures of one snapshot ``(H, W)`` of 8 bits, by the keys of :data:`COLUMNS`."""
    frequency, power = _spectrum(dn)
    return {
        "levels": len(np.unique(dn)),
        "bright": float(np.percentile(dn, BRIGHT)),
        "mean": float(dn.mean()),
        "white": 100 * float((dn == 255).mean()),
        "black": 100 * float((dn == 0).mean()),
        "fine": float(power[frequency >= FINE].sum() / max(power.sum(), 1e-12)),
    }


def _spectrum(dn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies in cycles a pixel and the power there, both ``(H, W)``."""
    window = np.outer(*(np.hanning(side + 2)[1:-1] for side in dn.shape))
    deviation = dn - np.average(dn, weights=window)
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(side) for side in dn.shape), indexing="ij"))
    return frequency, np.abs(np.fft.fft2(window * deviation)) ** 2


def _figure(snapshots: dict[str, dict[str, np.ndarray]], scene: str) -> Figure:
    """Draw one scene behind every mask with a close-up, and histogram and spectrum of all scenes of each mask."""
    figure = Figure(figsize=(12.5, 2.9 * len(snapshots)), layout="constrained")
    places = figure.add_gridspec(2 * len(snapshots), 3, width_ratios=[1.33, 1, 1.5])
    histogram = figure.add_subplot(places[: len(snapshots), 2])
    spectrum = figure.add_subplot(places[len(snapshots) :, 2])
    edges = np.linspace(0, 0.5, 41)
    for number, (mask, scenes) in enumerate(snapshots.items()):
        rows = slice(2 * number, 2 * number + 2)
        dn = scenes[scene]
        show_picture(figure.add_subplot(places[rows, 0]), dn, f"{scene}, {mask}", high=255)
        top, left = ((side - CLOSE_UP) // 2 for side in dn.shape)
        part = dn[top : top + CLOSE_UP, left : left + CLOSE_UP]
        show_picture(figure.add_subplot(places[rows, 1]), part, f"{CLOSE_UP} x {CLOSE_UP} pixels", high=part.max())
        counts = np.mean([np.bincount(one.ravel(), minlength=256) / one.size for one in scenes.values()], axis=0)
        histogram.step(np.arange(256), 100 * counts, where="mid", label=in_figure(mask))
        powers = []
        for one in scenes.values():
            frequency, power = _spectrum(one)
            sums, _ = np.histogram(frequency, edges, weights=power)
            powers.append(sums / power.sum())
        spectrum.plot((edges[1:] + edges[:-1]) / 2, 100 * np.mean(powers, axis=0), label=in_figure(mask))
    histogram.set(yscale="log", xlabel="level (DN)", ylabel="pixels (%)", title="levels used, all scenes")
    spectrum.set(yscale="log", xlabel="cycles a pixel", ylabel="variance (%)", title="spectrum, all scenes")
    spectrum.axvline(FINE, color="grey", linewidth=0.8, linestyle=":")
    for axes in (histogram, spectrum):
        axes.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    capture_range(Path(sys.argv[1]), sys.argv[2:])
