r"""How much of a scene a mask lets one see in the measurement itself: the paper's "motion-aware measurement", measured.

The paper says that behind a structural mask "the motionless objects, background, and motion trajectory could be greatly
recorded in the measurement", which "can be viewed as a coarse estimate of original video frames", and gives no number.
Ours is the PSNR of the mean measurement :math:`m = y / \sum_t M_t` against the frames. Its error has two parts,

.. math:: \tfrac{1}{T} \sum_t \|m - x_t\|^2 = \|m - \bar x\|^2 + \tfrac{1}{T} \sum_t \|\bar x - x_t\|^2,

where :math:`\bar x` is the mean of the frames, the photograph of the same exposure without a mask. The second part is
the scene's motion, whatever the mask; the first is what the mask writes over the photograph. An open shutter writes
nothing and is the most motion-aware of all, although nothing can be decoded behind it.

``python -m tests.studies.figures.motion_aware OUT SCENES MASK MASK ..`` writes OUT/motion_aware.json and .png; SCENES
is a folder with the six test scenes, or ``-`` for photographs of scikit-image that move.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure

from sci_lightning.data.six_scenes import SixScenes
from sci_lightning.data.source import Scene
from sci_lightning.data.synthetic import Synthetic
from sci_lightning.encoder.mask.measured import read_mask
from sci_lightning.errors import BadInput
from sci_lightning.figures.figure import show_picture, write_figure
from sci_lightning.metrics.psnr import psnr
from sci_lightning.operator import SnapshotOperator
from sci_lightning.plain_text import in_markdown
from tests.measurements_file import Column, MeasurementsFile

COLUMNS: list[Column] = [
    ("mask", "mask", None),
    ("frames", "mean measurement against the frames (dB)", 2),
    ("photograph", "against the photograph without a mask (dB)", 2),
]


def motion_aware(out: Path, scenes: str | None, files: Sequence[str | Path]) -> None:
    """Compare masks by how much of the scenes their measurements show.

    Args:
        out: folder of what is written.
        scenes: folder of the six test scenes; None: photographs of scikit-image that move.
        files: of masks, all of one T, H and W.

    Raises:
        BadInput: a file that holds no mask, masks of several shapes, or scenes that do not fit.
    """
    masks = {Path(file).stem: read_mask(file) for file in files}
    shapes = {tuple(mask.shape) for mask in masks.values()}
    if len(shapes) != 1 or len(masks) != len(files):
        raise BadInput(f"{', '.join(map(str, files))}: expected masks of one shape (T, H, W) and of different names")
    frames, height, width = shapes.pop()
    size = (height, width)
    shown = (Synthetic(frames, size, size) if scenes is None else SixScenes(scenes, frames, size)).scenes()
    rows: list[dict[str, Any]] = [{"mask": in_markdown(name), **awareness(mask, shown)} for name, mask in masks.items()]
    rows.append({"mask": "open shutter", **awareness(torch.ones(frames, *size), shown)})
    names = ", ".join(scene.name for scene in shown)
    scale = f"{frames} slots of {height} x {width}, ideal sensor; {names}"
    notes = ["PSNR, mean over frames, snapshots and scenes. No mask is ahead of the open shutter in either column."]
    command = f"python -m tests.studies.figures.motion_aware OUT {'SCENES' if scenes else '-'} {' '.join(masks)}"
    file = MeasurementsFile(out / "motion_aware.json", machine="computed", scale=scale, seeds="none", command=command)
    file.write(COLUMNS, rows, notes)
    write_figure(_figure(masks, shown[0].video[0]), out / "motion_aware.png")


def awareness(mask: torch.Tensor, scenes: Sequence[Scene]) -> dict[str, float]:
    """Return the PSNR in dB of the mean measurement, mean over the scenes.

    Args:
        mask: ``(T, H, W)`` in [0, 1].
        scenes: of as many frames and pixels.

    Returns:
        ``frames``: against the frames; ``photograph``: against their mean, at most 100.
    """
    operator = SnapshotOperator(mask)
    by_scene = []
    for scene in scenes:
        videos = [scene.video[number][None] for number in range(len(scene.video))]
        means = [operator.mean_frame(operator(video)) for video in videos]
        pairs = list(zip(means, videos, strict=True))
        frames = torch.stack([psnr(mean[:, None].expand_as(video), video).mean() for mean, video in pairs])
        photograph = torch.stack([psnr(mean, video.mean(1)).mean() for mean, video in pairs])
        by_scene.append(torch.stack([frames.mean(), photograph.mean()]))
    both = torch.stack(by_scene).mean(0).tolist()
    return dict(zip(("frames", "photograph"), both, strict=True))


def _figure(masks: dict[str, torch.Tensor], video: torch.Tensor) -> Figure:
    """Draw the photograph without a mask, and in every column a mean measurement above what its mask has written."""
    photograph = video.mean(0)
    figure = Figure(figsize=(2.7 * (len(masks) + 1), 6.0), layout="constrained")
    above, below = figure.subplots(2, len(masks) + 1)
    show_picture(above[0], photograph.numpy(), "without a mask")
    show_picture(below[0], video[0].numpy(), "first frame")
    for upper, lower, (name, mask) in zip(above[1:], below[1:], masks.items(), strict=True):
        operator = SnapshotOperator(mask)
        mean = operator.mean_frame(operator(video[None]))[0]
        decibel = float(psnr(mean.expand_as(video), video).mean())
        show_picture(upper, mean.numpy(), f"{name}: {decibel:.1f} dB")
        show_picture(lower, 3 * (mean - photograph).abs().numpy(), "difference x 3", colours="magma")
    return figure


if __name__ == "__main__":
    motion_aware(Path(sys.argv[1]), None if sys.argv[2] == "-" else sys.argv[2], sys.argv[3:])
