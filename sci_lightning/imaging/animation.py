"""Reconstructed videos as pictures and as an animation."""

from __future__ import annotations

from pathlib import Path

import torch
from PIL import Image

from sci_lightning.files.atomic_file import atomic_write


def to_bytes(video: torch.Tensor) -> torch.Tensor:
    """Return a video of any shape, clipped to [0, 1] and rounded, as uint8."""
    return (video.detach().float().clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu()


def write_frames(video: torch.Tensor, folder: str | Path) -> None:
    """Write ``(N, T, H, W)`` as 8-bit ``NNN_TT.png``: snapshot and frame, both counted from 0."""
    for snapshot, frames in enumerate(to_bytes(video).numpy()):
        for slot, frame in enumerate(frames):
            with atomic_write(Path(folder) / f"{snapshot:03d}_{slot:02d}.png") as temporary:
                Image.fromarray(frame).save(temporary)


def write_gif(video: torch.Tensor, path: str | Path, fps: float = 8.0) -> None:
    """Write ``(N, T, H, W)`` as one animated GIF that repeats, snapshot after snapshot."""
    first, *rest = [Image.fromarray(frame) for frame in to_bytes(video).flatten(0, 1).numpy()]
    with atomic_write(path) as temporary:
        first.save(temporary, save_all=True, append_images=rest, duration=1000 / fps, loop=0)
