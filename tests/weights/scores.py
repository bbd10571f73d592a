"""``python -m tests.weights.scores JSON``: what the weights are worth, on scenes and masks not trained on.

The first snapshot of each of the six scenes, and of the validation clips, behind new masks of several kinds and numbers
of slots, with 12 bits. The table of docs/results/weights.md is made from it.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

import sci_lightning as sci
from sci_lightning.data.six_scenes import LENGTHS, SixScenes
from sci_lightning.decoder import Decoder
from tests.conftest import SHARED
from tests.measurements_file import MeasurementsFile

SIZE = (256, 256)
LEVELS = 4095
MASKS: dict[str, Callable[[int], torch.Tensor]] = {
    "random binary": lambda frames: sci.masks.RandomBinary(frames=frames, size=SIZE, seed=1001)(),
    "random structural, 4 bits": lambda frames: sci.masks.RandomStructural(
        frames=frames, size=SIZE, bits=4, seed=1001
    )(),
    "shifting": lambda frames: sci.masks.Shifting(frames=frames, size=SIZE, seed=1001)(),
}


def six_scenes(frames: int) -> torch.Tensor:
    """Return the first frames of each of the six scenes, ``(N, T, H, W)``; those that are long enough."""
    names = [name for name, length in LENGTHS.items() if length >= frames]
    scenes = SixScenes(SHARED / "data" / "benchmark", frames, SIZE, scenes=names).scenes()
    return torch.stack([scene.video[0] for scene in scenes])


def validation_clips(frames: int) -> torch.Tensor:
    """Return the beginning of the validation clips, ``(N, T, H, W)``: the middle of the field."""
    clips = [np.load(file)["frames"] for file in sorted((SHARED / "data" / "val").glob("*.npz"))]
    middle = [clip[:frames, :, (clip.shape[2] - 256) // 2 :][..., :256] for clip in clips]
    return torch.from_numpy(np.stack(middle)).float() / 255


@torch.no_grad()
def row(decoder: Decoder, named: str, video: torch.Tensor, mask: torch.Tensor, about: dict[str, Any]) -> dict[str, Any]:
    """Decode every snapshot by itself, and score it."""
    white = float(mask.sum(0).max())
    measurement = ((mask * video).sum(1) / white * LEVELS).round() / LEVELS * white
    psnr, ssim, seconds = [], [], []
    for snapshot, truth in zip(measurement, video, strict=True):
        began = time.perf_counter()
        with torch.autocast("cpu", torch.bfloat16, enabled=named != "gap_tv"):
            estimate = decoder(snapshot[None], mask).float().clamp(0, 1)
        seconds.append(time.perf_counter() - began)
        psnr.append(float(sci.metrics.psnr(estimate, truth[None]).mean()))
        ssim.append(float(sci.metrics.ssim(estimate, truth[None]).mean()))
    scores = {"psnr": statistics.fmean(psnr), "ssim": statistics.fmean(ssim), "seconds": statistics.median(seconds)}
    return {**about, "frames": len(mask), "decoder": f"`{named}`", **scores}


def main(out: Path) -> None:
    file = MeasurementsFile(
        out,
        machine=f"{torch.get_num_threads()} cores",
        scale="256 x 256, 12 bits, no noise; the first snapshot of every scene, one at a time; networks in bfloat16",
        seeds="1001 (masks)",
        command="python -m tests.weights.scores docs/results/weights.json",
    )
    decoders = {name: sci.load_decoder(name) for name in ("gap_tv", "universal")}
    rows = []
    for scenes, source in (("six scenes", six_scenes), ("validation clips", validation_clips)):
        for frames in (8, 10, 16):
            for kind, draw in MASKS.items():
                if frames == 8 or kind == "random binary":
                    about = {"scenes": f"{scenes} ({len(source(frames))})", "mask": kind}
                    rows += [row(d, name, source(frames), draw(frames), about) for name, d in decoders.items()]
    columns = [
        ("scenes", "scenes", None),
        ("mask", "new mask", None),
        ("frames", "T", 0),
        ("decoder", "decoder", None),
        ("psnr", "PSNR (dB)", 2),
        ("ssim", "SSIM", 3),
        ("seconds", "seconds", 2),
    ]
    file.write(columns, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
