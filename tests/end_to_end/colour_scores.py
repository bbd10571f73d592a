"""Measure colour: ``python -m tests.end_to_end.colour_scores CLIPS docs/results/colour.json docs/results/colour.png``.

Three photographs of scikit-image in motion and the clips of a folder are recorded by a Bayer camera and decoded: as
four gray snapshots, and as one as if it were gray; both are demosaiced alike. Beside them stands what demosaicing alone
loses. The picture shows the last clip, decoded with the shipped weights.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import torch
from PIL import Image

from sci_lightning.cli.notebook import load_decoder
from sci_lightning.configuration.bounds import CHANNELS
from sci_lightning.data import Folder, Synthetic
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import Bayer
from sci_lightning.encoder.sensor.bayer import demosaiced, mosaic
from sci_lightning.figures.figure import reconstruction_figure
from sci_lightning.metrics import psnr, ssim
from sci_lightning.pipeline import Pipeline
from tests.measurements_file import MeasurementsFile

SIZE, FRAMES, SHOWN = (256, 256), 8, 2
DECODERS = {"GAP-TV": "gap_tv", "shipped weights": "universal"}


@torch.no_grad()
def measure(clips: Path, file: Path, picture: Path) -> None:
    """Write the table and the picture."""
    measured = MeasurementsFile(
        file,
        machine="one thread",
        scale="three photographs in motion and two clips, a snapshot each, 256 x 256, T = 8, 8 bits, aperture 1/T",
        seeds="0",
        command="python -m tests.end_to_end.colour_scores CLIPS docs/results/colour.json docs/results/colour.png",
    )
    made = Synthetic(FRAMES, SIZE, scenes_count=3, snapshots_per_scene=1).colour_scenes()
    filmed = Folder(clips, FRAMES, SIZE, SIZE, val_root=clips).colour_scenes()
    encoder = Encoder(RandomBinary(FRAMES, SIZE, seed=0), Bayer(), aperture="1/T")
    videos = {scene.name: scene.video[0][None] for scene in (*made, *filmed)}
    snapshots = {name: encoder(video) for name, video in videos.items()}
    ways: dict[str, Callable[[str], torch.Tensor]] = {"demosaicing alone": lambda name: mosaic(videos[name], "rggb")}
    for title, decoder in ((title, load_decoder(name)) for title, name in DECODERS.items()):
        pipeline = Pipeline(encoder, decoder)
        ways[title] = lambda name, used=pipeline: used.reconstruct(snapshots[name])
        ways[f"{title}, as if gray"] = lambda name, used=decoder: used(snapshots[name], encoder.transmittance())
    rows = []
    for way, decode in ways.items():
        scores = []
        for name, video in videos.items():
            pair = demosaiced(decode(name), "rggb")[0], video[0]
            scores.append([*psnr(*pair).mean(-1).tolist(), float(psnr(*pair).mean()), float(ssim(*pair).mean())])
        means = torch.tensor(scores, dtype=torch.float64).mean(0).tolist()
        rows.append({"way": way, **dict(zip((*CHANNELS, "mean", "ssim"), means, strict=True))})
        print(rows[-1])
        if way == "shipped weights":
            figure = reconstruction_figure(snapshots[name].recorded()[0], video[0], pair[0], "", SHOWN)
            figure.savefig(picture, dpi=190, bbox_inches="tight")
            drawn = Image.open(picture).convert("RGB")  # in 256 colours, which take a third of the room
            drawn.quantize(palette=drawn.quantize(256), dither=Image.Dither.FLOYDSTEINBERG).save(picture)
    columns = [(name, f"{name} (dB)", 2) for name in (*CHANNELS, "mean")]
    measured.write([("way", "", None), *columns, ("ssim", "SSIM", 3)], rows)


if __name__ == "__main__":
    measure(*map(Path, sys.argv[1:4]))
