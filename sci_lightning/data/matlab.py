"""Frames out of MATLAB files, old and new."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput


def read_matlab_video(path: Path, key: str) -> np.ndarray:
    """Reads the frames that a MATLAB file holds under ``key`` on the 0 to 255 scale.

    Args:
        path: a MATLAB 5 file (read by SciPy) or a MATLAB 7.3 one (which is HDF5, with its axes reversed).
        key: the variable's name; (H, W, F) in MATLAB. Values of at most 1 overall count as scaled already.

    Returns:
        float32 ``(F, H, W)`` in [0, 1].

    Raises:
        BadInput: the file is missing, damaged or without ``key``, or holds something else than frames.
    """
    import h5py
    from scipy.io import loadmat

    try:
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                keys = [name for name in file if not name.startswith("#")]
                array = np.asarray(file[key]).T if key in keys else None
        else:
            variables = loadmat(path)
            keys = [name for name in variables if not name.startswith("__")]
            array = variables.get(key)
    except Exception as error:  # SciPy and h5py raise many kinds for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise BadInput(f"{path}: cannot be read as a MATLAB file ({reason}); is it complete?") from error

    if array is None:
        raise BadInput(f"{path}: holds {', '.join(keys) or 'nothing'}; the frames should be under '{key}'")
    if array.ndim != 3 or array.dtype.kind not in "uif":
        raise BadInput(f"{path}: '{key}' is {array.dtype} {array.shape}; expected numbers (H, W, F)")
    low, high = float(array.min()), float(array.max())
    if not (low >= 0 and high <= 255):  # written so that NaN fails too
        raise BadInput(f"{path}: '{key}' holds values from {low:g} to {high:g}; expected 0 to 255")
    video = np.ascontiguousarray(np.moveaxis(array, -1, 0), dtype=np.float32)
    return video if high <= 1 else video / np.float32(255)
