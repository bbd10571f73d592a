"""Reconstructed videos as pictures, animations and an overview, all of bounded size and bright enough to be seen."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

from sci_lightning.files.atomic_file import atomic_write

FRAME = re.compile(r"\d{3,}_\d{2,}\.png")
"""Names of the pictures of single frames."""
LONGEST_PICTURE = 655_350
"""Milliseconds for which a GIF can show a picture; frames that are alike become one."""
MOST_FRAMES_SHOWN = 512
"""Of a longer video, so many frames are shown in an animation."""
GIF_PIXELS, MP4_PIXELS = 12 * 10**6, 50 * 10**6
"""Pixels of all frames of an animation. A GIF of noise takes 1.5 bytes for each, one of a scene about half of that."""
OVERVIEW_WIDTH = 1920
"""Pixels."""
OVERVIEW_FRAMES, OVERVIEW_SNAPSHOTS = 8, 6
CAPTION, GAP = 14, 8
"""Pixels: the height of a caption, and between two pictures."""
GIF_LEVELS = 64
"""Of gray, which the eye cannot tell from 256 in a moving picture, and which take three quarters of the room."""
Video = torch.Tensor | np.ndarray
"""A video, also one that is read from a file as it is needed."""


def picture(frame: Video, white: float = 1.0) -> Image.Image:
    """Return a frame ``(H, W)`` or ``(H, W, 3)`` as a picture of 8 bits: 0 is black, ``white`` and more is white."""
    values = frame.detach() if isinstance(frame, torch.Tensor) else torch.from_numpy(np.array(frame))
    return Image.fromarray(((values.float() / white).clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy())


def write_frames(video: Video, folder: str | Path, white: float = 1.0) -> None:
    """Write ``(N, T, H, W)``, in colour ``(N, T, H, W, 3)``, as 8-bit ``NNN_TT.png``: snapshot and frame, from 0.

    Frames of that name that an earlier video left in the folder and this one has not are removed.
    """
    folder = Path(folder)
    earlier = {path for path in folder.glob("*.png") if FRAME.fullmatch(path.name) and not path.is_symlink()}
    for snapshot, frames in enumerate(video):
        for slot, frame in enumerate(frames):
            path = folder / f"{snapshot:03d}_{slot:02d}.png"
            with atomic_write(path) as temporary:
                picture(frame, white).save(temporary)
            earlier.discard(path)
    for path in earlier:
        path.unlink()


def write_gif(video: Video, path: str | Path, fps: float = 8.0, white: float = 1.0) -> str:
    """Write ``(N, T, H, W)`` or ``(N, T, H, W, 3)`` as one animated GIF that repeats, snapshot after snapshot.

    Args:
        video: nominally in [0, 1].
        path: of the file.
        fps: frames per second, at most 50, which is the fastest that browsers show. Frames of a long, slow animation
            are shown for a shorter time, so that all of them together could be one picture.
        white: the value that is shown as white.

    Returns:
        What was left out to keep the file small, in words; empty if nothing was.
    """
    pictures, count, left_out = _animation(video, GIF_PIXELS, white)
    duration = min(1000 / fps, LONGEST_PICTURE / count)
    with atomic_write(path) as temporary:
        next(pictures).save(temporary, save_all=True, append_images=pictures, duration=duration, loop=0)
    return left_out


def write_side_by_side(snapshots: torch.Tensor, video: torch.Tensor, path: str | Path, fps: float = 8.0) -> None:
    """Write a GIF of snapshots ``(N, H, W)`` and, beside each, the frames ``(N, T, H, W)`` decoded from it, in turn."""
    shown = snapshots / snapshots.quantile(0.99)  # to be seen, not to be measured
    drawn = []
    for snapshot, frames in zip(shown, video, strict=True):
        for slot, frame in enumerate(frames):
            height, width = frame.shape
            canvas = Image.new("L", (2 * width + GAP, height + CAPTION), 255)
            canvas.paste(picture(snapshot), (0, CAPTION))
            canvas.paste(picture(frame), (width + GAP, CAPTION))
            ImageDraw.Draw(canvas).text((2, 1), "one snapshot", fill=0)
            ImageDraw.Draw(canvas).text((width + GAP + 2, 1), f"frame {slot + 1} of {len(frames)} from it", fill=0)
            drawn.append(canvas.quantize(GIF_LEVELS))
    with atomic_write(path) as temporary:
        drawn[0].save(temporary, "GIF", save_all=True, append_images=drawn[1:], duration=1000 / fps, loop=0)


def write_mp4(video: Video, path: str | Path, fps: float = 8.0, white: float = 1.0) -> bool:
    """Write the same as an MP4; return False, and write nothing, where PyAV is not installed (the extra ``video``)."""
    try:
        import av
    except ImportError:
        return False
    pictures, _, _ = _animation(video, MP4_PIXELS, white, even=True)
    first = next(pictures)
    codec = "libx264" if "libx264" in av.codec.codecs_available else "mpeg4"
    with atomic_write(path) as temporary, av.open(str(temporary), "w", format="mp4") as container:
        stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = *first.size, "yuv420p"
        for shown in (first, *pictures):
            levels = "gray" if shown.mode == "L" else "rgb24"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(shown), format=levels)))
        container.mux(stream.encode(None))
    return True


def write_overview(measurement: Video, video: Video, path: str | Path, white: float = 1.0) -> None:
    """Write a picture with one row for every snapshot: the snapshot, then its frames.

    Of more than :data:`OVERVIEW_SNAPSHOTS` the first are shown, and of more than :data:`OVERVIEW_FRAMES` frames so many
    at equal distances.

    Args:
        measurement: ``(N, H, W)``, shown from 0 to its largest value.
        video: ``(N, T, H, W)`` or ``(N, T, H, W, 3)``.
        path: of the PNG.
        white: the value of a frame that is shown as white.
    """
    slots, height, width = video.shape[1:4]
    rows = min(len(video), OVERVIEW_SNAPSHOTS)
    shown = np.linspace(0, slots - 1, min(slots, OVERVIEW_FRAMES)).round().astype(int)
    scale = min(OVERVIEW_WIDTH / (len(shown) + 1) / width, max(1.0, 128 / width), OVERVIEW_WIDTH / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    mode, paper = ("L", 255) if video.ndim == 4 else ("RGB", (255, 255, 255))
    sheet = Image.new(mode, ((len(shown) + 1) * size[0], rows * (size[1] + CAPTION)), paper)
    captions = ImageDraw.Draw(sheet)
    for row in range(rows):
        brightest = max(float(measurement[row].max()), 1e-6)
        tiles = [(f"snapshot {row}", measurement[row], brightest)]
        tiles += [(f"frame {slot}", video[row, slot], white) for slot in shown]
        for column, (caption, values, level) in enumerate(tiles):
            left, top = column * size[0], row * (size[1] + CAPTION)
            captions.text((left + 2, top + 1), caption, fill=0)
            sheet.paste(picture(values, level).resize(size, Image.Resampling.BOX), (left, top + CAPTION))
    with atomic_write(path) as temporary:
        sheet.save(temporary)


def _animation(video: Video, most: int, white: float, even: bool = False) -> tuple[Iterator[Image.Image], int, str]:
    """Return the pictures of an animation of at most so many pixels, their number, and what was left out, in words."""
    snapshots, slots, height, width = video.shape[:4]
    count = min(snapshots * slots, MOST_FRAMES_SHOWN)
    scale = min(1.0, math.sqrt(most / (count * height * width)))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if even:  # as the colour planes of a film need it
        size = max(2, size[0] - size[0] % 2), max(2, size[1] - size[1] % 2)
    frames = islice((frame for one in video for frame in one), count)
    pictures = (picture(frame, white) for frame in frames)
    left_out = [f"the first {count} of {snapshots * slots} frames"] * (count < snapshots * slots)
    left_out += [f"{size[0]} x {size[1]} of {width} x {height} pixels"] * (scale < 1)
    fitted = (one if one.size == size else one.resize(size, Image.Resampling.BOX) for one in pictures)
    return fitted, count, ", ".join(left_out)
