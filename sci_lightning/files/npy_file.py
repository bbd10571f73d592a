"""NumPy's formats .npy and .npz: the header first, the numbers only if they are there."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from sci_lightning.files.memory_bound import check_stored
from sci_lightning.files.stored_array import StoredArray


def npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    """Read shape and type of an .npy stream, which is left at the first number.

    Raises:
        ValueError: no such header.
    """
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def npy_array(path: Path) -> StoredArray:
    """Return the array of an .npy file without reading its numbers.

    Raises:
        ValueError, OSError: no .npy file.
    """
    with path.open("rb") as stream:
        shape, dtype = npy_header(stream)
        stored = os.fstat(stream.fileno()).st_size - stream.tell()

    def read() -> np.ndarray:
        check_stored(f"its array of shape {shape}", math.prod(shape) * dtype.itemsize, stored, compressed=False)
        with path.open("rb") as stream:
            return npy.read_array(stream, allow_pickle=False)

    return StoredArray(shape, str(dtype), dtype.kind in "buif", read)


def npz_arrays(path: Path) -> dict[str, StoredArray]:
    """List the arrays of an .npz file by name without reading their numbers.

    Raises:
        OSError, ValueError, zipfile.BadZipFile: no .npz file.
    """
    with zipfile.ZipFile(path) as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        return {entry.filename.removesuffix(".npy"): _entry(path, archive, entry) for entry in entries}


def _entry(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> StoredArray:
    with archive.open(entry) as stream:
        shape, dtype = npy_header(stream)
        header = stream.tell()

    def read() -> np.ndarray:
        declared, what = math.prod(shape) * dtype.itemsize, f"'{entry.filename.removesuffix('.npy')}' of shape {shape}"
        check_stored(what, declared, entry.file_size - header, compressed=False)
        check_stored(what, declared, entry.compress_size, compressed=True)
        with zipfile.ZipFile(path) as archive, archive.open(entry) as stream:
            return npy.read_array(stream, allow_pickle=False)

    return StoredArray(shape, str(dtype), dtype.kind in "buif", read)


def write_npy(path: str | Path, shape: tuple[int, ...], parts: Iterable[np.ndarray]) -> None:
    """Write a float32 array to an .npy file part by part, so that memory never holds all of it.

    Args:
        path: the file.
        shape: of the array.
        parts: its parts along the first dimension, in their order.
    """
    with Path(path).open("wb") as stream:
        npy.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
        for part in parts:
            np.ascontiguousarray(part, "<f4").tofile(stream)
