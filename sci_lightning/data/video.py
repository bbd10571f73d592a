"""One video as a notebook wants it, from whatever file or folder the sources of this package read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import torch

from sci_lightning.data.reader import find_clips, frame_files, read_frames
from sci_lightning.data.video_array import read_video_array
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import ENDINGS
from sci_lightning.files.memory_bound import check_memory

FLOAT_BYTES = 4


def load_video(
    path: str | Path,
    frames: int | None = None,
    *,
    size: Sequence[int] | int | None = None,
    snapshots: int | None = None,
    key: str | None = None,
) -> torch.Tensor:
    """Read a video as gray frames, in groups of the frames of one snapshot.

    >>> import numpy as np
    >>> import sci_lightning as sci
    >>> np.savez("clip.npz", frames=np.zeros((20, 48, 64), np.uint8))
    >>> tuple(sci.load_video("clip.npz").shape), tuple(sci.load_video("clip.npz", 8, size=(32, 32)).shape)
    ((1, 20, 48, 64), (2, 8, 32, 32))

    Args:
        path: a video file, a folder of pictures, an ``.npz`` file, or an array in a ``.mat``, ``.npy`` or HDF5 file on
            the scale of 0 to 1 or 0 to 255. A folder that holds one clip stands for that clip. Colour becomes luma.
        frames: T, the frames of one snapshot; frames that are left over at the end are dropped. None for all frames in
            one group.
        size: ``(H, W)`` in pixels, or the side of a square, cut out of the centre; None for the whole frames.
        snapshots: how many groups are read at most, with ``frames``; None for all.
        key: name of the array in a ``.mat`` or HDF5 file; None for ``orig``, or the only one of three dimensions.

    Returns:
        float32 ``(N, T, H, W)`` in [0, 1]; N is 1 without ``frames``.

    Raises:
        BadInput: there is no such clip or more than one, it cannot be read, it is too short or too small, or it does
            not fit into memory.
    """
    path = Path(path)
    size = (size, size) if isinstance(size, int) else size
    for name, number in (("frames", frames), ("snapshots", snapshots)):
        if number is not None and number < 1:
            raise BadInput(f"{name}={number}: must be at least 1")
    if snapshots is not None and frames is None:
        raise BadInput(f"snapshots={snapshots}: say as well how many frames a snapshot has, as in frames=8")
    most = None if snapshots is None or frames is None else snapshots * frames
    if path.suffix.lower() in ENDINGS and not (path.is_dir() or (path.suffix.lower() == ".npz" and key is None)):
        video = _cut(read_video_array(path, key)[:most], size, path)
    elif key is not None:
        raise BadInput(f"{path}: key={key} names an array in a .mat, .npz or HDF5 file, which this is not")
    else:
        video = _read(_the_clip(path), most, size)
    count = len(video) if frames is None else len(video) // frames * frames
    if not count:
        raise BadInput(f"{path}: {len(video)} frames, fewer than the {frames} of one snapshot")
    return torch.from_numpy(video[:count]).reshape(-1, frames or count, *video.shape[1:])


def _the_clip(path: Path) -> Path:
    """Return the clip that a path stands for: itself, or the only one in a folder."""
    if path.is_dir() and frame_files(path):
        return path
    clips = find_clips(path)
    if len(clips) > 1:
        names = ", ".join(str(clip.relative_to(path)) for clip in clips[:3])
        raise BadInput(f"{path}: holds {len(clips)} clips ({names}, ..); give the path of one of them")
    return clips[0]


def _read(path: Path, most: int | None, size: Sequence[int] | None) -> np.ndarray:
    """Return the first frames of a clip, float32 ``(F, H, W)``; what is cut off is never kept."""
    read: list[np.ndarray] = []
    for number, frame in enumerate(islice(read_frames(path), most), start=1):
        read.append(np.ascontiguousarray(_cut(frame, size, path)))
        if number.bit_count() == 1:  # a film may not fit: ask at 1, 2, 4, .. frames whether as many again would
            check_memory(f"{path}: {2 * number} frames of {frame.shape}", 2 * number * read[0].size * (FLOAT_BYTES + 1))
    return np.stack(read).astype(np.float32) / np.float32(255)


def _cut(frames: np.ndarray, size: Sequence[int] | None, path: Path) -> np.ndarray:
    """Return the centre of frames ``(.., H, W)``."""
    if size is None:
        return frames
    height, width = size
    rows, columns = frames.shape[-2:]
    if not (1 <= height <= rows and 1 <= width <= columns):
        raise BadInput(f"{path}: frames of {rows} x {columns} pixels; size={list(size)} must lie within them")
    top, left = (rows - height) // 2, (columns - width) // 2
    return np.ascontiguousarray(frames[..., top : top + height, left : left + width])
