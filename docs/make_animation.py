"""Make the moving picture of README.md: coded snapshots of a clip, and beside them the frames that come back.

    python docs/make_animation.py CLIP.npz docs/reconstruction.gif

CLIP.npz holds ``frames``, uint8 ``(T, H, W)``; of these the first 24, and the 256 x 256 pixels in their middle, are
recorded through a random binary mask of 8 slots (``encoder=rbw_osr``), and decoded by ``gap_tv``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

import sci_lightning as sci
from sci_lightning.files.atomic_file import atomic_write

SLOTS, SNAPSHOTS, SIDE = 8, 3, 256
GAP, HEAD = 8, 16  # pixels between the two pictures, and above them for what they are
LEVELS = 64  # of gray, which the eye cannot tell from 256 here, and which take three quarters of the room


def main(clip: str, out: str) -> None:
    """Record, decode, draw, and print the PSNR in dB."""
    with np.load(clip) as content:
        frames = content["frames"][: SLOTS * SNAPSHOTS]
    rows, columns = (slice((whole - SIDE) // 2, (whole + SIDE) // 2) for whole in frames.shape[1:])
    video = torch.from_numpy(frames[:, rows, columns]).float().unflatten(0, (SNAPSHOTS, SLOTS)) / 255
    encoder = sci.Encoder(sci.masks.RandomBinary(SLOTS, (SIDE, SIDE), seed=0), sci.sensors.Ideal())
    pipeline = sci.Pipeline(encoder, sci.load_decoder("gap_tv"))
    with torch.no_grad():
        snapshots, estimate = encoder(video), pipeline(video).clamp(0, 1)
    print(f"{-10 * (estimate - video).square().mean((2, 3)).log10().mean():.1f} dB, mean over frames")
    snapshots = (snapshots / snapshots.quantile(0.99)).clamp(max=1)  # to be seen, not to be measured
    drawn = [_drawn(snapshots[n], estimate[n, t], t) for n in range(len(video)) for t in range(SLOTS)]
    with atomic_write(Path(out)) as temporary:
        drawn[0].save(temporary, "GIF", save_all=True, append_images=drawn[1:], duration=125, loop=0, optimize=True)


def _drawn(snapshot: torch.Tensor, frame: torch.Tensor, slot: int) -> Image.Image:
    canvas = torch.ones(SIDE + HEAD, 2 * SIDE + GAP)
    canvas[HEAD:, :SIDE], canvas[HEAD:, -SIDE:] = snapshot, frame
    picture = Image.fromarray((canvas * (LEVELS - 1)).round().mul(255 / (LEVELS - 1)).to(torch.uint8).numpy())
    draw = ImageDraw.Draw(picture)
    draw.text((2, 2), "one snapshot", fill=0)
    draw.text((SIDE + GAP + 2, 2), f"frame {slot + 1} of {SLOTS} from it", fill=0)
    return picture


if __name__ == "__main__":
    main(*sys.argv[1:])
