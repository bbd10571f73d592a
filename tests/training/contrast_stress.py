"""``python -m tests.training.contrast_stress TRAIN VALIDATION RUN..``: what trained networks make of unusual contrast.

Validation clips are shown as they are and changed: in negative, darker, with three times the contrast, as black and
white. A network whose weights have grown too much amplifies what it has never seen; its pixels are far off then.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import torch

from sci_lightning.data import Folder
from sci_lightning.runs.checkpoint import read_checkpoint
from sci_lightning.training.muon import is_large

CHANGES: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "as it is": lambda video: video,
    "negative": lambda video: 1 - video,
    "gamma 3": lambda video: video**3,
    "contrast times 3": lambda video: (3 * video - 1).clamp(0, 1),
    "black and white": lambda video: (video > 0.5).float(),
}


@torch.no_grad()
def stress(run: Path, source: Folder) -> str:
    """Return the norms of large weights and, for each change, the PSNR and the part of pixels that are off by 0.6."""
    checkpoint = read_checkpoint(run / "checkpoints" / "last.ckpt")
    encoder, decoder = checkpoint.encoder().eval(), checkpoint.decoder().eval()
    mask = encoder.transmittance()
    norms = [torch.linalg.matrix_norm(w.flatten(1), 2).item() for w in decoder.parameters() if is_large(w)]
    parts = [f"norms {min(norms):.1f} to {max(norms):.1f}"]
    for name, change in CHANGES.items():
        errors, off = [], []
        for scene in source.scenes():
            video = change(torch.as_tensor(scene.video[0]).float()[None])
            error = decoder(encoder.normalised(encoder.record(video, mask)), mask) - video
            errors.append(error.square().mean().item())
            off.append((error.abs() > 0.6).float().mean().item())
        psnr = -10 * math.log10(sum(errors) / len(errors))
        parts.append(f"{name}: {psnr:.2f} dB, {100 * sum(off) / len(off):.2f} % off")
    return f"{run.name}: {'; '.join(parts)}"


if __name__ == "__main__":
    train, validation, *runs = sys.argv[1:]
    clips = Folder(train, 8, (256, 256), (64, 64), 0, val_root=validation, clips_per_epoch=1)
    for place in runs:
        print(stress(Path(place), clips), flush=True)
