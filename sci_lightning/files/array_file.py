"""One array out of a .npy, .npz, .mat (4 to 7.3) or HDF5 file, and nothing else of that file."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.stored_array import StoredArray, readable_shape
from sci_lightning.plain_text import excerpt

if TYPE_CHECKING:
    import h5py

ENDINGS = (".npy", ".npz", ".mat", ".h5", ".hdf5")
LONGEST_CLASS = 64
"""Bytes of the name of a MATLAB class."""
FAR_SHORTER, LEAST_SIDE = 4, 16
"""How many times shorter than the sides of the field the time must be, and pixels of those, for a guess from both."""
MOST_NAMED = 20
"""Arrays of a file that a message names."""


def read_array(
    path: str | Path,
    *,
    prefer: str,
    dimensions: int | Sequence[int],
    key: str | Sequence[str] | None = None,
    setting: str = "",
) -> np.ndarray:
    """Read a numeric array with time (or the snapshot's number) first.

    MATLAB keeps ``(H, W, T)``: an array out of a .mat file is turned to ``(T, H, W)``, of either version, and a
    two-dimensional one stays ``(H, W)``. Other arrays of the file are not read; an HDF5 file cannot name another file.

    Args:
        path: one of :data:`ENDINGS`.
        prefer: name of the array when ``key`` is None, as it is or with ``_bayer`` behind it; failing that the only
            array with ``dimensions`` will do.
        dimensions: how many the array must have; axes of length 1 of one that has more are dropped, but in MAT files.
            Of several numbers, arrays of the first come before those of the next, which are looked at only where there
            is none of the first.
        key: name of the array in a .mat, .npz or HDF5 file, or several of which the first that there is counts.
        setting: what the user sets to choose the array, for the message; empty where there is nothing to set.

    Raises:
        BadInput: missing or unreadable file, unknown ending, no such array, not numeric, other dimensions, more than
            the file holds or than the bounds of memory_bound.py allow.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: {'is a folder, expected a file' if path.is_dir() else 'no such file'}")
    if path.suffix.lower() not in ENDINGS:
        raise BadInput(f"{path}: cannot read an array from '{path.suffix}'; use one of {', '.join(ENDINGS)}")
    allowed = (dimensions,) if isinstance(dimensions, int) else tuple(dimensions)
    try:
        if path.suffix.lower() in (".npy", ".npz", ".mat") and not _is_hdf5(path):
            return _read(path, _choose(path, _arrays(path), prefer, key, allowed, setting), allowed)
        return _read_hdf5(path, prefer, key, allowed, setting)
    except BadInput as error:
        raise error if str(error).startswith(str(path)) else BadInput(f"{path}: {error}") from error
    except PermissionError as error:
        raise BadInput(f"{path}: you may not read this file (permission denied)") from error
    except Exception as error:  # the readers raise whatever they like on a damaged file
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise BadInput(f"{path}: not a readable {path.suffix} file, damaged or truncated ({reason})") from error


def time_first(
    path: str | Path, array: np.ndarray, field: Sequence[int] | None = None, frames: int | None = None
) -> np.ndarray:
    """Return an array of :func:`read_array` with time first although its file has another order than its format.

    Python users save ``(T, H, W)`` to MAT files as well, and some NPY files hold ``(H, W, T)``. The other order is
    taken where only that one fits what is known of the size; where that decides nothing, where it makes the shortest
    axis by far the time. A warning says so.

    Args:
        path: the file.
        array: ``(T, H, W)`` by the order of its format.
        field: (H, W) that it should have, if known.
        frames: T, if known.
    """
    ending = Path(path).suffix.lower()
    matlab = ending == ".mat"
    other = np.moveaxis(array, 0, -1) if matlab else np.moveaxis(array, -1, 0)

    def fit(shape: tuple[int, ...]) -> int:
        return 2 * (field is not None and shape[1:] == tuple(field)) + (frames is not None and shape[0] == frames)

    usual, turned = fit(array.shape), fit(other.shape)
    shortest_is_time = 2 <= len(other) <= min(other.shape[1:]) / FAR_SHORTER and min(other.shape[1:]) >= LEAST_SIDE
    if turned < usual or (turned == usual and not shortest_is_time):
        return array
    order = ("last", "first") if matlab else ("first", "last")
    warnings.warn(
        f"{path}: {ending} files have time {order[0]}, this one seems to have it {order[1]}: read as "
        f"{readable_shape(other.shape)} (T x H x W)",
        InputWarning,
        stacklevel=2,
    )
    return other


def _read(path: Path, stored: StoredArray, dimensions: tuple[int, ...]) -> np.ndarray:
    shape = stored.shape
    if len(shape) > max(dimensions) and path.suffix.lower() != ".mat":
        shape = tuple(side for side in shape if side != 1)
    if len(shape) not in dimensions or not stored.numeric or 0 in shape:
        numbers = " or ".join(map(str, sorted(dimensions)))
        raise BadInput(
            f"{path}: expected a numeric array of {numbers} dimensions, found {stored.dtype} of shape {stored.shape}"
        )
    array = stored.read()
    if array.shape != stored.shape or array.dtype.kind not in "buif":
        raise ValueError(f"declared {stored.dtype} of shape {stored.shape}, holds {array.dtype} of {array.shape}")
    return array.reshape(shape)


def _choose(
    path: Path,
    arrays: dict[str, StoredArray],
    prefer: str,
    key: str | Sequence[str] | None,
    dimensions: tuple[int, ...],
    setting: str,
) -> StoredArray:
    if path.suffix.lower() == ".npy":
        return arrays[""]
    names = [prefer] if key is None else [key] if isinstance(key, str) else list(key)
    for name in (*names, *([f"{prefer}_bayer"] if key is None else [])):
        if name in arrays:
            return arrays[name]
    by_dimensions = [[array for array in arrays.values() if len(array.shape) == number] for number in dimensions]
    fitting = next(filter(None, by_dimensions), [])
    if key is None and len(fitting) == 1:
        return fitting[0]
    wanted = "' or '".join(names)
    listed = [f"{name} {array.shape}" for name, array in arrays.items()]
    more = f" and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else ""
    choose = f"; choose one with {setting}=NAME" if listed and setting else ""
    raise BadInput(
        f"{path}: no array named '{wanted}'; the file holds {', '.join(listed[:MOST_NAMED]) or 'nothing'}{more}{choose}"
    )


def _arrays(path: Path) -> dict[str, StoredArray]:
    from sci_lightning.files.npy_file import npy_array, npz_arrays

    if path.suffix.lower() in (".npy", ".npz"):
        return {"": npy_array(path)} if path.suffix.lower() == ".npy" else npz_arrays(path)
    from sci_lightning.files.matlab5_file import is_matlab4, matlab4_arrays, matlab5_arrays

    return matlab4_arrays(path) if is_matlab4(path) else matlab5_arrays(path)


def array_names(path: str | Path) -> set[str]:
    """Return the names of the arrays in a .mat, .npz or HDF5 file; none of another file.

    Raises:
        BadInput: a damaged file.
    """
    from sci_lightning.files.hdf5_file import hdf5_datasets, open_hdf5

    path = Path(path)
    if path.suffix.lower() not in ENDINGS[1:]:
        return set()
    try:
        if path.suffix.lower() in (".mat", ".npz") and not _is_hdf5(path):
            return set(_arrays(path))
        with open_hdf5(path) as file:
            return set(hdf5_datasets(file))
    except BadInput:
        raise
    except Exception as error:  # the readers raise whatever they like on a damaged file
        raise BadInput(f"{path}: not a readable {path.suffix} file, damaged or truncated ({excerpt(error)})") from error


def _is_hdf5(path: Path) -> bool:
    import h5py

    return path.suffix.lower() == ".mat" and bool(h5py.is_hdf5(path))


def _read_hdf5(
    path: Path, prefer: str, key: str | Sequence[str] | None, dimensions: tuple[int, ...], setting: str
) -> np.ndarray:
    from sci_lightning.files.hdf5_file import hdf5_datasets, open_hdf5

    matlab = path.suffix.lower() == ".mat"
    with open_hdf5(path) as file:
        arrays = {
            name: _stored(name, item, matlab)
            for name, item in hdf5_datasets(file).items()
            if item.dtype.kind in "buif" and not name.startswith("#")  # what MATLAB keeps for itself
        }
        return _read(path, _choose(path, arrays, prefer, key, dimensions, setting), dimensions)


def _stored(name: str, item: h5py.Dataset, matlab: bool) -> StoredArray:
    from sci_lightning.files.hdf5_file import read_dataset

    shape: tuple[int, ...] = item.shape or ()
    logical = matlab and _is_logical(item)

    def read() -> np.ndarray:
        values = read_dataset(name, item)
        return values.astype(bool) if logical else values

    if not matlab or len(shape) < 2:
        return StoredArray(shape, str(item.dtype), True, read)
    # version 7.3 stores MATLAB's axes in reverse: (T, W, H)
    turned = (*shape[:-2], shape[-1], shape[-2])
    return StoredArray(turned, str(item.dtype), True, lambda: np.swapaxes(read(), -1, -2))


def _is_logical(item: h5py.Dataset) -> bool:
    """Whether MATLAB calls a dataset of bytes an array of truth values."""
    name = "MATLAB_class"
    if name not in item.attrs or item.attrs.get_id(name).get_storage_size() > LONGEST_CLASS:
        return False
    return bytes(np.asarray(item.attrs[name], "S")) == b"logical"
