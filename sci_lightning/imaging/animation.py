"""Reconstructed videos as pictures and as an animation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from sci_lightning.files.atomic_file import atomic_write

FRAME = re.compile(r"\d{3,}_\d{2,}\.png")
"""Names of the pictures of single frames."""
LONGEST_PICTURE = 655_350
"""Milliseconds for which a GIF can show a picture; frames that are alike become one."""
Video = torch.Tensor | np.ndarray
"""A video, also one that is read from a file as it is needed."""


def picture(frame: Video) -> Image.Image:
    """Return a frame ``(H, W)``, clipped to [0, 1] and rounded, as a picture of 8 bits."""
    values = frame.detach() if isinstance(frame, torch.Tensor) else torch.from_numpy(np.array(frame))
    return Image.fromarray((values.float().clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy())


def write_frames(video: Video, folder: str | Path) -> None:
    """Write ``(N, T, H, W)`` as 8-bit ``NNN_TT.png``: snapshot and frame, both counted from 0.

    Frames of that name that an earlier video left in the folder and this one has not are removed.
    """
    folder = Path(folder)
    earlier = {path for path in folder.glob("*.png") if FRAME.fullmatch(path.name) and not path.is_symlink()}
    for snapshot, frames in enumerate(video):
        for slot, frame in enumerate(frames):
            path = folder / f"{snapshot:03d}_{slot:02d}.png"
            with atomic_write(path) as temporary:
                picture(frame).save(temporary)
            earlier.discard(path)
    for path in earlier:
        path.unlink()


def write_gif(video: Video, path: str | Path, fps: float = 8.0) -> None:
    """Write ``(N, T, H, W)`` as one animated GIF that repeats, snapshot after snapshot.

    Args:
        video: in [0, 1].
        path: of the file.
        fps: frames per second, at most 50, which is the fastest that browsers show. Frames of a long, slow animation
            are shown for a shorter time, so that all of them together could be one picture.
    """
    pictures = (picture(frame) for frames in video for frame in frames)
    duration = min(1000 / fps, LONGEST_PICTURE / (video.shape[0] * video.shape[1]))
    with atomic_write(path) as temporary:
        next(pictures).save(temporary, save_all=True, append_images=pictures, duration=duration, loop=0)
