"""Mosaics: mask, measurement and reconstruction, a row for each encoder that a decoder was trained with."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

import torch
from matplotlib.figure import Figure

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.data import Synthetic
from sci_lightning.errors import describe
from sci_lightning.figures.figure import show_picture
from sci_lightning.pipeline import Pipeline
from sci_lightning.plain_text import file_name, in_figure
from sci_lightning.runs.checkpoint import read_checkpoint
from sci_lightning.studies.tables.run import ScoredRun

Shown = TypeVar("Shown")
"""What is shown of a checkpoint."""

PICTURES = 4
"""Of each encoder."""


def mosaics(runs: Sequence[ScoredRun], side: int, left_out: Callable[[str], None]) -> Iterator[tuple[str, Figure]]:
    """A file's name and a figure for each scale and decoder of ours whose runs left a checkpoint.

    Args:
        runs: of any seed; the first seed's are shown.
        side: of the scene that is shown, in pixels; a held-out one of the embedded photographs, the same for all.
        left_out: called with a line for each checkpoint that is of no use; the others are shown.
    """
    members = {part: {path.stem for path in (CONF / part).glob("*.yaml")} for part in ("encoder", "decoder")}
    groups: dict[tuple[str, str, int], dict[str, Path]] = {}
    for run in sorted(runs, key=lambda run: (run.fields["encoder"], run.fields["bits"], run.seed)):
        ours = all(run.fields[part] in names for part, names in members.items())
        if ours and run.checkpoint and run.fields["test_encoder"] == run.fields["encoder"]:
            rows = groups.setdefault((run.setting.scale, str(run.fields["decoder"]), run.parameters), {})
            rows.setdefault(f"{run.fields['encoder']}, {run.fields['bits']} bit", run.checkpoint)
    taken: set[str] = set()
    for (scale, decoder, parameters), rows in groups.items():
        pictures = usable(rows, lambda path: _pictures(path, side), left_out)
        if not pictures:
            continue
        name = file_name(f"mosaic_{scale}_{decoder}")
        if name in taken:  # the same network in another size, or scales that differ in nothing a file name can show
            name = next(f"{name}_{number}" for number in count(2) if f"{name}_{number}" not in taken)
        taken.add(name)
        yield name, _mosaic(f"{decoder}, scale {scale}, {parameters:,} parameters", pictures)


def retrained_mosaics(
    runs: Sequence[ScoredRun], encoder: str, decoders: Sequence[str], side: int, left_out: Callable[[str], None]
) -> Iterator[tuple[str, Figure]]:
    """A file's name and a figure for each scale: reconstructions of networks trained with one encoder, side by side.

    Source: the paper's Figure 6, networks that were retrained with RBw/SR.

    Args:
        runs, side, left_out: see :func:`mosaics`.
        encoder: with which they were trained and are tested.
        decoders: in the order of the columns; a scale of which fewer than two were run has no figure.
    """
    scales: dict[str, dict[str, Path]] = {}
    for run in sorted(runs, key=lambda run: run.seed):
        trained = run.fields["encoder"] == run.fields["test_encoder"] == encoder
        if trained and run.fields["decoder"] in decoders and run.checkpoint:
            scales.setdefault(run.setting.scale, {}).setdefault(str(run.fields["decoder"]), run.checkpoint)
    for scale, paths in scales.items():
        shown = {name: paths[name] for name in decoders if name in paths}
        pictures = usable(shown, lambda path: _pictures(path, side), left_out)
        if len(pictures) > 1:
            yield file_name(f"retrained_{scale}"), _side_by_side(f"trained with {encoder}, scale {scale}", pictures)


def _side_by_side(title: str, networks: dict[str, dict[str, torch.Tensor]]) -> Figure:
    """The true frame, then every network's reconstruction of it."""
    figure = Figure(figsize=(1.9 * (len(networks) + 1), 2.5), layout="constrained")
    figure.suptitle(in_figure(title, 100), fontsize=10)
    truth, *panels = figure.subplots(1, len(networks) + 1, squeeze=False)[0]
    for axes, (name, pictures) in zip(panels, networks.items(), strict=True):
        *_, (label, frame), (reconstruction, estimate) = pictures.items()
        show_picture(truth, frame.numpy(), label)
        show_picture(axes, estimate.numpy(), f"{name}\n{reconstruction}")
    return figure


def usable(rows: dict[str, Path], read: Callable[[Path], Shown], left_out: Callable[[str], None]) -> dict[str, Shown]:
    """Return what is shown of every row whose checkpoint is of use; ``left_out`` gets a line for each of the others."""
    pictures = {}
    for name, path in rows.items():
        try:
            pictures[name] = read(path)
        except Exception as error:  # whatever a checkpoint of another version, or of anybody, makes a network do
            reason = describe(error)
            left_out(reason if str(path) in reason else f"{path}: {reason}")
    return pictures


def _mosaic(title: str, rows: dict[str, dict[str, torch.Tensor]]) -> Figure:
    figure = Figure(figsize=(1.9 * PICTURES, 2.1 * len(rows) + 0.3), layout="constrained")
    figure.suptitle(in_figure(title, 100), fontsize=10)
    panels = figure.subplots(len(rows), PICTURES, squeeze=False)
    for row, (name, pictures) in zip(panels, rows.items(), strict=True):
        for axes, (label, picture) in zip(row, pictures.items(), strict=True):
            show_picture(axes, picture.numpy(), label, high=max(1.0, float(picture.max())))
        place: dict[str, Any] = {"transform": row[0].transAxes, "rotation": 90, "va": "center", "ha": "right"}
        row[0].text(-0.08, 0.5, in_figure(name), fontsize=9, **place)
    return figure


@torch.no_grad()
def _pictures(path: Path, side: int) -> dict[str, torch.Tensor]:
    """What a checkpoint's camera and decoder make of the scene, by the words above each picture."""
    checkpoint = read_checkpoint(path)
    encoder, decoder = checkpoint.encoder().eval(), checkpoint.decoder()
    height, width = (min(side, full) for full in encoder.size)
    truth = Synthetic(encoder.mask.frames, (height, width), (height, width), scenes_count=1).scenes()[0].video[0][None]
    pipeline = Pipeline(encoder, decoder)
    mask = encoder.transmittance()[:, :height, :width]
    measurement = pipeline.record(truth, mask)
    estimate = pipeline.decode(pipeline.linearise(measurement), pipeline.decoder_mask(mask))[0]
    middle = len(mask) // 2
    psnr = -10 * float((estimate[middle] - truth[0, middle]).square().mean().log10())
    return {
        "mask, slot 1": mask[0],
        "measurement": measurement[0],
        f"frame {middle + 1}": truth[0, middle],
        f"reconstruction, {psnr:.2f} dB": estimate[middle],
    }
