"""Masks out of files: their values are checked, and what may be wrong with their axes is said."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.configuration.bounds import MOST_FRAMES
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array
from sci_lightning.files.stored_array import readable_shape


def read_mask_file(
    path: str | Path, key: str | None = None, *, one_pattern: bool = False, setting: str = ""
) -> np.ndarray:
    """Read a mask with time first, of the type of numbers that the file has.

    Args:
        path: .npy, .h5 or .hdf5 holding ``(T, H, W)``, or .mat (version 5 or 7.3) holding MATLAB's ``(H, W, T)``.
        key: name of the array in a .mat or HDF5 file; None takes ``mask``, else the only array that fits.
        one_pattern: whether ``(H, W)`` will do as well.
        setting: what the user sets to choose the array, for the message; empty where there is nothing to set.

    Raises:
        BadInput: the file cannot be read or lacks the array, fewer than 2 slots or more than
            :data:`~sci_lightning.configuration.bounds.MOST_FRAMES`, or values outside [0, 1].
    """
    dimensions = (3, 2) if one_pattern else 3
    mask = read_array(path, prefer="mask", key=key, dimensions=dimensions, setting=setting)
    shape = f"the mask is {readable_shape(mask.shape)} (T x H x W)"
    if mask.ndim == 3 and len(mask) == 1:
        raise BadInput(f"{path}: {shape}, a single slot; a snapshot is the sum of at least 2")
    if mask.ndim == 3 and len(mask) > MOST_FRAMES:
        raise BadInput(f"{path}: {shape}, expected at most {MOST_FRAMES} time slots; are its axes in another order?")
    low, high = float(np.float32(mask.min())), float(np.float32(mask.max()))
    if np.isnan(low):
        raise BadInput(f"{path}: the mask holds NaN; every value must be a transmittance in [0, 1]")
    if not (low >= 0 and high <= 1):
        raise BadInput(
            f"{path}: mask values must lie in [0, 1] (transmittance), found {low:g} to {high:g}; divide by the largest "
            "displayed level first"
        )
    return mask


def doubtful_axes(mask: Sequence[int], field: Sequence[int]) -> str:
    """Return a question about the order of a mask's axes where another order would fit; else nothing.

    Args:
        mask: its shape, read as (T, H, W).
        field: (H, W) that it should have.
    """
    if tuple(mask[:2]) == tuple(field):
        return "time comes first: is it stored as H x W x T?"
    if tuple(mask[1:]) == tuple(field)[::-1]:
        return "are H and W swapped?"
    return ""
