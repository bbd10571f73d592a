"""Frames from MATLAB files, of version 5 and 7.3."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array


def read_matlab_video(path: str | Path, key: str) -> np.ndarray:
    """Read the frames that a MATLAB file holds under ``key`` on the 0 to 255 scale.

    Args:
        path: a MATLAB 5 file (read by SciPy) or a MATLAB 7.3 one (which is HDF5, with its axes reversed).
        key: the variable's name; (H, W, F) in MATLAB. Values of at most 1 overall count as scaled already.

    Returns:
        float32 ``(F, H, W)`` in [0, 1].

    Raises:
        BadInput: the file is missing, damaged or without ``key``, or does not hold frames.
    """
    array = read_array(path, key=key, prefer=key, dimensions=3)
    low, high = float(array.min()), float(array.max())
    if not (low >= 0 and high <= 255):  # written so that NaN fails too
        raise BadInput(f"{path}: '{key}' holds values from {low:g} to {high:g}; expected 0 to 255")
    video = np.ascontiguousarray(array, dtype=np.float32)
    return video if high <= 1 else video / np.float32(255)
