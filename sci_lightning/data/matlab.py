"""Frames from an array of a file: MATLAB of any version, NumPy or HDF5."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array

ORIGINAL = "orig"
"""What the field calls the frames of a test scene."""


def read_matlab_video(path: str | Path, key: str | None = None) -> np.ndarray:
    """Read the frames that a file holds under ``key`` on the 0 to 255 scale.

    Args:
        path: .mat, .npy, .h5 or .hdf5, see :func:`~sci_lightning.files.array_file.read_array`.
        key: the variable's name; (H, W, F) in MATLAB. Values of at most 1 overall count as scaled already. None for
            ``orig``, or the only array of three dimensions.

    Returns:
        float32 ``(F, H, W)`` in [0, 1].

    Raises:
        BadInput: the file is missing, damaged or without ``key``, or does not hold frames.
    """
    array = read_array(path, key=key, prefer=ORIGINAL, dimensions=3)
    low, high = float(array.min()), float(array.max())
    if not (low >= 0 and high <= 255):  # written so that NaN fails too
        name = f"'{key}' " if key else ""
        raise BadInput(f"{path}: {name}holds values from {low:g} to {high:g}; expected 0 to 255")
    video = np.ascontiguousarray(array, dtype=np.float32)
    return video if high <= 1 else video / np.float32(255)
