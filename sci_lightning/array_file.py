"""One array out of a .npy, .mat (5 and 7.3) or HDF5 file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.errors import BadInput

ENDINGS = (".npy", ".mat", ".h5", ".hdf5")


def read_array(path: str | Path, *, prefer: str, dimensions: int, key: str | None = None) -> np.ndarray:
    """Read a numeric array with time (or the snapshot's number) first.

    MATLAB keeps ``(H, W, T)``: an array out of a .mat file is turned to ``(T, H, W)``, of either version, and a
    two-dimensional one stays ``(H, W)``.

    Args:
        path: .npy, .mat, .h5 or .hdf5.
        prefer: name of the array when ``key`` is None; failing that the only array with ``dimensions`` will do.
        dimensions: how many the array must have.
        key: name of the array in a .mat or HDF5 file.

    Raises:
        BadInput: missing or unreadable file, unknown ending, no such array, not numeric, other dimensions.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    if path.suffix.lower() not in ENDINGS:
        raise BadInput(f"{path}: cannot read an array from '{path.suffix}'; use one of {', '.join(ENDINGS)}")
    try:
        arrays = _arrays(path)
    except Exception as error:  # the readers raise whatever they like on a damaged file
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise BadInput(f"{path}: not a readable {path.suffix} file, damaged or truncated ({reason})") from error
    array = _choose(path, arrays, prefer, key, dimensions)
    if array.ndim != dimensions or array.dtype.kind not in "buif" or array.size == 0:
        raise BadInput(
            f"{path}: expected a numeric array of {dimensions} dimensions, found {array.dtype} of shape {array.shape}"
        )
    return array


def _choose(path: Path, arrays: dict[str, np.ndarray], prefer: str, key: str | None, dimensions: int) -> np.ndarray:
    if path.suffix.lower() == ".npy":
        return arrays[""]
    if (name := key or prefer) in arrays:
        return arrays[name]
    fitting = [array for array in arrays.values() if array.ndim == dimensions]
    if key is None and len(fitting) == 1:
        return fitting[0]
    found = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    raise BadInput(f"{path}: no array named '{name}'; the file holds {found}")


def _arrays(path: Path) -> dict[str, np.ndarray]:
    if path.suffix.lower() == ".npy":
        return {"": np.load(path, allow_pickle=False)}
    if path.suffix.lower() == ".mat" and not _is_hdf5(path):
        from scipy.io import loadmat

        found = {name: value for name, value in loadmat(path).items() if not name.startswith("__")}
        return {name: _time_first(value) for name, value in found.items()}
    arrays = _hdf5(path)
    if path.suffix.lower() == ".mat":  # version 7.3 stores MATLAB's axes in reverse: (T, W, H)
        return {name: np.swapaxes(value, -1, -2) if value.ndim >= 2 else value for name, value in arrays.items()}
    return arrays


def _time_first(value: np.ndarray) -> np.ndarray:
    return np.moveaxis(value, -1, 0) if value.ndim == 3 else value


def _is_hdf5(path: Path) -> bool:
    import h5py

    return bool(h5py.is_hdf5(path))


def _hdf5(path: Path) -> dict[str, np.ndarray]:
    import h5py

    arrays: dict[str, np.ndarray] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "buif":
            arrays[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(keep)
    return arrays
