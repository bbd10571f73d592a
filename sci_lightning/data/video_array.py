"""Frames from files of arrays: MATLAB's of any version, HDF5, .npz and .npy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array, time_first

VIDEO_NAMES = ("frames", "orig")
"""Names of the array of frames; the files of the papers' test scenes call it ``orig``."""


def read_video_array(
    path: str | Path,
    key: str | Sequence[str] | None = "orig",
    size: Sequence[int] | None = None,
    colour: bool = False,
) -> np.ndarray:
    """Read the frames that a file of arrays holds under ``key`` on the 0 to 255 scale.

    Args:
        path: one of :data:`~sci_lightning.files.array_file.ENDINGS`.
        key: the array's name, or several of which the first that the file has counts; (H, W, F) in MATLAB, else
            (F, H, W), see :func:`~sci_lightning.files.array_file.time_first`. Values of at most 1 overall count as
            scaled already. None for ``orig``, or the only array of three dimensions.
        size: (H, W) that the frames should have, if known.
        colour: whether they are in colour: (H, W, 3, F) in MATLAB, else (F, H, W, 3).

    Returns:
        float32 ``(F, H, W)`` in [0, 1]; in colour ``(F, H, W, 3)``.

    Raises:
        BadInput: the file is missing, damaged or without ``key``, or does not hold frames.
    """
    array = read_array(path, key=key, prefer="orig", dimensions=4 if colour else 3)
    if not colour:
        array = time_first(path, array, size)
    elif 3 not in (array.shape[1], array.shape[3]):
        raise BadInput(f"{path}: frames of shape {array.shape}, expected red, green and blue")
    elif array.shape[1] == 3:
        array = np.moveaxis(array, 1, -1)
    low, high = float(array.min()), float(array.max())
    if not (low >= 0 and high <= 255):  # written so that NaN fails too
        name = f"'{key if isinstance(key, str) else ' or '.join(key)}' " if key else ""
        raise BadInput(f"{path}: {name}holds values from {low:g} to {high:g}; expected 0 to 255")
    video = np.ascontiguousarray(array, dtype=np.float32)
    return video if high <= 1 else video / np.float32(255)
