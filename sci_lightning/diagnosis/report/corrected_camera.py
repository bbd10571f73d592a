"""The corrected camera for use elsewhere: effective masks as files, and a snapshot reconstructed before and after."""

from __future__ import annotations

from pathlib import Path

import torch
from matplotlib.figure import Figure
from scipy.io import savemat

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.diagnosis.blind.held_out.paired_comparison import PairedComparison
from sci_lightning.diagnosis.blind.held_out.prediction import default_decoder, effective_mask, textured_window
from sci_lightning.diagnosis.report.svg import AFTER, BEFORE, style
from sci_lightning.encoder import Encoder
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.npy_file import write_npy
from sci_lightning.operator import SnapshotOperator

SIDE = 192
"""Side in pixels of the part of a snapshot that is reconstructed for the report."""
SHOWN = 3
"""Frames that are shown."""


def write_effective_mask(encoder: Encoder, out: str | Path) -> None:
    """Write what multiplies every frame on the sensor's pixels: ``effective_mask.npy`` and ``effective_mask.mat``.

    Both are float32; the first is ``(T, H, W)``, the second holds ``mask`` as MATLAB's ``(H, W, T)``. They serve any
    decoder, of this project or another, that takes a measured mask.

    Args:
        encoder: the corrected camera.
        out: the folder.
    """
    mask = effective_mask(encoder).float().contiguous().numpy()
    with atomic_write(Path(out) / "effective_mask.npy") as temporary:
        write_npy(temporary, mask.shape, iter(mask))
    with atomic_write(Path(out) / "effective_mask.mat") as temporary, temporary.open("wb") as stream:
        savemat(stream, {"mask": mask.transpose(1, 2, 0)}, do_compression=True)


def prediction_figure(comparison: PairedComparison, numbers: tuple[int, ...], verification: tuple[int, ...]) -> Figure:
    """Draw the prediction error of every snapshot before and after.

    Args:
        comparison: of the camera as it was given and the corrected one.
        numbers: of the snapshots in their file.
        verification: those of them that no fit has seen.
    """
    with style():
        figure = Figure(figsize=(1.6 + 0.75 * len(numbers), 2.8), layout="constrained")
        axes = figure.subplots()
        for shift, colour, which in ((-0.19, BEFORE, 0), (0.19, AFTER, 1)):
            heights = [pair[which] for pair in comparison.by_capture]
            places = [place + shift for place in range(len(numbers))]
            axes.bar(places, heights, 0.36, color=colour, label=("before", "after")[which])
        names = [f"{number}\n(verifies)" if number in verification else str(number) for number in numbers]
        axes.set_xticks(range(len(numbers)), names)
        axes.set(xlabel="snapshot", ylabel="prediction error")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
        return figure


@torch.no_grad()
def reconstruction_figure(
    measurement: torch.Tensor, before: Encoder, after: Encoder, decoder: Decoder | None = None
) -> Figure:
    """Draw a part of one snapshot, and frames of it as reconstructed by two cameras.

    Args:
        measurement: ``(H, W)``, normalised by full scale.
        before, after: the camera as it was given, and the corrected one.
        decoder: None for :func:`~sci_lightning.diagnosis.blind.held_out.prediction.default_decoder`.
    """
    decoder = default_decoder() if decoder is None else decoder
    rows, columns = textured_window(measurement[None], SIDE)
    origin = rows.start, columns.start
    part = measurement[None, rows, columns].float()
    videos = []
    for encoder in (before, after):
        mask = effective_mask(encoder)[:, rows, columns]
        scale = (part.quantile(0.99) / SnapshotOperator(encoder.mask()).total().mean()).clamp(min=1e-9)
        videos.append(decoder(encoder.linearise(part, origin) / scale, mask)[0])
    slots = torch.linspace(0, len(videos[0]) - 1, SHOWN).round().long().tolist()
    top = max(float(video[slots].quantile(0.995)) for video in videos)
    with style():
        figure = Figure(figsize=(1.65 * (SHOWN + 1), 3.7), layout="constrained")
        axes = figure.subplots(2, SHOWN + 1)
        for line, (name, video) in zip(axes, zip(("before", "after"), videos, strict=True), strict=True):
            line[0].imshow(part[0], cmap="gray", interpolation="nearest")
            line[0].set_title("snapshot", loc="left")
            line[0].set_ylabel(name)
            for place, slot in zip(line[1:], slots, strict=True):
                place.imshow(video[slot], cmap="gray", vmin=0, vmax=top, interpolation="nearest")
                place.set_title(f"slot {slot}", loc="left")
        for place in axes.ravel():
            place.set_xticks([])
            place.set_yticks([])
            place.spines[:].set_visible(False)
        return figure
