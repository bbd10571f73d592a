"""Mosaics: mask, measurement and reconstruction, a row for each encoder that a decoder was trained with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from matplotlib.figure import Figure

from sci_lightning.checkpoint import read_checkpoint
from sci_lightning.command import CONF
from sci_lightning.data import Synthetic
from sci_lightning.figures import show_picture
from sci_lightning.paper_tables.run import Run
from sci_lightning.system import System

PICTURES = 4
"""Of each encoder."""


def mosaics(runs: Sequence[Run], side: int) -> Iterator[tuple[str, Figure]]:
    """A name and a figure for each scale and decoder of ours whose runs left a checkpoint.

    Args:
        runs: of any seed; the first seed's are shown.
        side: of the scene that is shown, in pixels; a held-out one of the embedded photographs, the same for all.
    """
    groups: dict[tuple[str, str, int], dict[str, Path]] = {}
    for run in sorted(runs, key=lambda run: (run.fields["encoder"], run.fields["bits"], run.seed)):
        path = run.path.parent / "checkpoints" / "last.ckpt"
        ours = all((CONF / part / f"{run.fields[part]}.yaml").is_file() for part in ("encoder", "decoder"))
        if ours and path.is_file() and run.fields["test_encoder"] == run.fields["encoder"]:
            rows = groups.setdefault((run.setting.scale, str(run.fields["decoder"]), run.parameters), {})
            rows.setdefault(f"{run.fields['encoder']}, {run.fields['bits']} bit", path)
    names = [f"mosaic_{scale}_{decoder}" for scale, decoder, _ in groups]
    for (scale, decoder, parameters), rows in groups.items():
        name = f"mosaic_{scale}_{decoder}"
        title = f"{decoder}, scale {scale}, {parameters:,} parameters"
        yield name if names.count(name) == 1 else f"{name}_{parameters}", _mosaic(title, rows, side)


def _mosaic(title: str, rows: dict[str, Path], side: int) -> Figure:
    figure = Figure(figsize=(1.9 * PICTURES, 2.1 * len(rows) + 0.3), layout="constrained")
    figure.suptitle(title, fontsize=10)
    for axes, (name, path) in zip(figure.subplots(len(rows), PICTURES, squeeze=False), rows.items(), strict=True):
        for each, (label, picture) in zip(axes, _pictures(path, side).items(), strict=True):
            show_picture(each, picture.numpy(), label, high=max(1.0, float(picture.max())))
        axes[0].text(-0.08, 0.5, name, transform=axes[0].transAxes, rotation=90, va="center", ha="right", fontsize=9)
    return figure


@torch.no_grad()
def _pictures(path: Path, side: int) -> dict[str, torch.Tensor]:
    """What a checkpoint's camera and decoder make of the scene, by the words above each picture."""
    checkpoint = read_checkpoint(path)
    encoder, decoder = checkpoint.encoder().eval(), checkpoint.decoder().eval()
    height, width = (min(side, full) for full in encoder.mask.size)
    truth = Synthetic(encoder.mask.frames, (height, width), (height, width), scenes_count=1).scenes()[0].video[0][None]
    system = System(encoder, decoder)
    measurement, mask = system.shoot(truth, encoder.transmittance()[:, :height, :width])
    estimate = decoder(*system.decodable(measurement, mask))[0]
    middle = len(mask) // 2
    psnr = -10 * float((estimate[middle] - truth[0, middle]).square().mean().log10())
    return {
        "mask, slot 1": mask[0],
        "measurement": measurement[0],
        f"frame {middle + 1}": truth[0, middle],
        f"reconstruction, {psnr:.2f} dB": estimate[middle],
    }
