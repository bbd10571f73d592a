"""Masks out of files: patterns as calibrations, cameras and modulators' software save them, as transmittances."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.configuration.bounds import MOST_FRAMES
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import ENDINGS, read_array, time_first
from sci_lightning.files.picture_file import matching_files, pictures_of, read_stack
from sci_lightning.files.stored_array import readable_shape

MASK_FILES = "MAT, NPY, NPZ or HDF5, a TIFF stack, or a folder of pictures (PNG, BMP, PGM, JPEG, TIFF)"
"""What :func:`read_mask_file` reads, in words."""
FULL_LEVELS = (255, 1023, 4095, 16383, 65535)
"""Largest whole numbers of 8, 10, 12, 14 and 16 bits."""
BEYOND, MOST_BEYOND = 0.1, 0.01
"""Part of white minus dark by which values may lie beyond the two, and part of the pixels that may lie further out."""


def read_mask_file(
    path: str | Path,
    key: str | None = None,
    *,
    one_pattern: bool = False,
    setting: str = "",
    field: Sequence[int] | None = None,
    frames: int | None = None,
    dark: float | None = None,
    white: float | None = None,
) -> np.ndarray:
    """Read a mask with time first, of the type of numbers that the file has where those lie in [0, 1].

    Args:
        path: .npy, .npz, .h5 or .hdf5 holding ``(T, H, W)``; .mat (any version) holding MATLAB's ``(H, W, T)``; a TIFF
            stack; a folder of pictures, one a slot, in the natural order of their names, or a pattern such as
            ``'mask/*.png'`` that several pictures fit; the folder that ``export_mask`` wrote. For other orders of the
            axes see :func:`~sci_lightning.files.array_file.time_first`.
        key: name of the array in a .mat, .npz or HDF5 file; None takes ``mask``, else the only array that fits.
        one_pattern: whether ``(H, W)`` will do as well.
        setting: what the user sets to choose the array, for the message; empty where there is nothing to set.
        field, frames: (H, W) and T that the mask should have, if known; only the order of axes depends on them.
        dark, white: numbers in the file that are transmittance 0 and 1, see :func:`transmittance`.

    Raises:
        BadInput: the file cannot be read or lacks the array, fewer than 2 slots or more than
            :data:`~sci_lightning.configuration.bounds.MOST_FRAMES`, or values that are no transmittances.
    """
    path = Path(path)
    if path.suffix.lower() in ENDINGS and not path.is_dir():
        mask = read_array(path, prefer="mask", key=key, dimensions=(3, 2) if one_pattern else 3, setting=setting)
        mask = time_first(path, mask, field, frames) if mask.ndim == 3 else mask
    else:
        mask = _pictures(path)
        mask = mask[0] if one_pattern and len(mask) == 1 else mask
    shape = f"the mask is {readable_shape(mask.shape)} (T x H x W)"
    if mask.ndim == 3 and len(mask) == 1:
        raise BadInput(f"{path}: {shape}, a single slot; a snapshot is the sum of at least 2")
    if mask.ndim == 3 and len(mask) > MOST_FRAMES:
        raise BadInput(f"{path}: {shape}, expected at most {MOST_FRAMES} time slots; are its axes in another order?")
    return transmittance(mask, str(path), dark, white, setting.removesuffix("key"))


def transmittance(
    values: np.ndarray, where: str, dark: float | None = None, white: float | None = None, settings: str = ""
) -> np.ndarray:
    """Return a mask's values as transmittances in [0, 1].

    With ``white``, they are (value - dark) / (white - dark), cut to [0, 1]. Without, values in [0, 1] stay as they are,
    the two values 0 and L of a binary mask become 0 and 1, and whole numbers that begin at 0 are divided by the largest
    of their type: that of 8 bits where the brightest has more than half of it, those of more bits where it is reached.

    Args:
        values: of any shape.
        where: the file, for messages.
        dark, white: numbers that mean 0 and 1; ``dark`` is 0 where only ``white`` is given.
        settings: how the names of the user's settings begin, before ``dark`` and ``white``; empty where there are none.

    Raises:
        BadInput: NaN; other values, with the settings that may be right; settings that do not fit the values.
    """
    low, high = float(np.float32(values.min())), float(np.float32(values.max()))
    if np.isnan(low):
        raise BadInput(f"{where}: the mask holds NaN; every value must be a transmittance in [0, 1]")
    values_in = f"{low:g} to {high:g}"
    if white is not None or dark is not None:
        dark = 0.0 if dark is None else float(dark)
        if white is None:
            raise BadInput(
                f"{settings}dark={dark:g}: give {settings}white= too, what an open pixel has; found {values_in}"
            )
        if not white > dark:
            raise BadInput(f"{settings}white={white:g}: must be larger than {settings}dark={dark:g}")
        scaled = (values.astype(np.float32) - np.float32(dark)) / np.float32(white - dark)
        beyond = float(((scaled < -BEYOND) | (scaled > 1 + BEYOND)).mean())
        if beyond > MOST_BEYOND:
            raise BadInput(
                f"{where}: {beyond:.0%} of the mask's values lie beyond {settings}dark={dark:g} and "
                f"{settings}white={white:g}; they reach from {values_in}"
            )
        return scaled.clip(0, 1)
    if low >= 0 and high <= 1:
        return values
    if low == 0 and bool(((values == 0) | (values == values.max())).all()):
        return (values > 0).astype(np.uint8)
    whole = values.dtype.kind in "ui" or bool((values == np.round(values)).all())
    if low == 0 and whole and (high in FULL_LEVELS or (values.dtype == np.uint8 and high > FULL_LEVELS[0] / 2)):
        return values.astype(np.float32) / np.float32(max(high, FULL_LEVELS[0]))
    if low < 0:
        advice = "a coding of -1 and 1 takes two exposures: give the mask of one"
    else:
        part = values.reshape(-1)[:: max(1, values.size // 10**6)]
        closed, opened = (float(f"{value:.4g}") for value in np.percentile(part, (1, 99)))
        closed, opened = (closed if closed < 0.5 * opened else 0.0), (high if low == 0 and whole else opened)
        how = f"{settings}dark={closed:g} {settings}white={opened:g}" if settings else f"{closed:g} and {opened:g}"
        advice = f"which numbers mean closed and open? If its darkest and brightest pixels do: {how}"
    raise BadInput(f"{where}: mask values must lie in [0, 1] (transmittance), found {values_in}; {advice}")


def _pictures(path: Path) -> np.ndarray:
    """Read the pictures ``(T, H, W)`` of a TIFF stack, a folder or the files that a pattern fits."""
    from sci_lightning.files.modulator_files import SHEET, read_planes

    if path.is_dir() and (path / SHEET).is_file():
        return read_planes(path).numpy()
    return np.concatenate(read_stack(pictures_of(path) if path.is_dir() else matching_files(path), prefer="mask"))


def doubtful_axes(mask: Sequence[int], field: Sequence[int]) -> str:
    """Return a question about the order of a mask's axes where another order would fit; else nothing.

    Args:
        mask: its shape, read as (T, H, W).
        field: (H, W) that it should have.
    """
    if tuple(mask[1:]) == tuple(field)[::-1]:
        return "are H and W swapped?"
    return ""
