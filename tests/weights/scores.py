"""``python -m tests.weights.scores FOLDER [NAME ..]``: what the weights are worth, on scenes and masks not trained on.

The first snapshot of each of the six scenes, and of the validation clips, behind new masks of several kinds and numbers
of slots, with 12 bits. The tables of docs/results/weights.md are made from FOLDER/weights-NAME.json.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
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
LEVELS, CAMERA_LEVELS = 4095, 255
Source = Callable[[int], torch.Tensor]
COLUMNS = [
    ("scenes", "scenes", None),
    ("mask", "mask", None),
    ("frames", "T", 0),
    ("decoder", "decoder", None),
    ("psnr", "PSNR (dB)", 2),
    ("ssim", "SSIM", 3),
    ("seconds", "seconds", 2),
]
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
def row(
    decoder: Decoder, named: str, video: torch.Tensor, mask: torch.Tensor, about: dict[str, Any], levels: int = LEVELS
) -> dict[str, Any]:
    """Decode every snapshot by itself, and score it."""
    white = float(mask.sum(0).max())
    measurement = ((mask * video).sum(1) / white * levels).round() / levels * white
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


def main(folder: Path, names: Sequence[str]) -> None:
    """Write the tables of ``names``, all of them where none is named."""
    decoders = {name: sci.load_decoder(name) for name in ("gap_tv", "universal")}

    def of_universal(scenes: str, source: Source) -> Iterator[dict[str, Any]]:
        for frames in (8, 10, 16):
            for kind, draw in MASKS.items():
                if frames == 8 or kind == "random binary":
                    about = {"scenes": f"{scenes} ({len(source(frames))})", "mask": kind}
                    yield from (row(d, name, source(frames), draw(frames), about) for name, d in decoders.items())

    def of_denoisers(scenes: str, source: Source) -> Iterator[dict[str, Any]]:
        about, mask = {"scenes": scenes, "mask": "random binary"}, MASKS["random binary"](8)
        compared = {name: sci.load_decoder(name) for name in ("gap_tv", "pnp_ffdnet", "pnp_fastdvdnet", "universal")}
        yield from (row(d, name, source(8), mask, about) for name, d in compared.items())

    def of_camera(scenes: str, source: Source) -> Iterator[dict[str, Any]]:
        about, camera = {"scenes": scenes, "mask": "its own"}, sci.load_weights("lsw_sr")
        compared = {**decoders, "lsw_sr": camera.decoder()}
        mask = camera.encoder().mask()
        yield from (row(d, name, source(8), mask, about, CAMERA_LEVELS) for name, d in compared.items())

    tables = {"universal": of_universal, "denoisers": of_denoisers, "lsw_sr": of_camera}
    for named in names or tables:
        file = MeasurementsFile(
            folder / f"weights-{named}.json",
            machine=f"{torch.get_num_threads()} cores",
            scale=f"256 x 256, {8 if named == 'lsw_sr' else 12} bits, no noise; the first snapshot of every scene, one "
            "at a time; networks in bfloat16",
            seeds="1001 (masks)",
            command=f"python -m tests.weights.scores docs/results {named}",
        )
        sources: dict[str, Source] = {"six scenes": six_scenes, "validation clips": validation_clips}
        if named == "denoisers":  # half an hour for the six scenes alone
            del sources["validation clips"]
        file.write(COLUMNS, [line for scenes, source in sources.items() for line in tables[named](scenes, source)])


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
