"""MATLAB's format before 7.3, whose variables are listed without being read.

A file is a header of 128 bytes and elements; each is a type and a length, 4 bytes each, and so many bytes: a matrix,
or the deflated bytes of one. A matrix begins with its flags, dimensions and name.
Source: MathWorks, "MAT-File Format", version 5.
"""

from __future__ import annotations

import io
import math
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.memory_bound import LARGEST_RATIO, UNCHECKED, check_stored, inflates_beyond
from sci_lightning.stored_array import StoredArray

HEADER, COMPRESSED, MATRIX = 128, 15, 14
BEGINNING = 4096
"""Bytes that hold flags, dimensions (32 at most) and name of any variable."""

NUMBERS = ("float64", "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
CLASSES = dict(enumerate(("cell", "struct", "object", "char", "sparse", *NUMBERS, "function", "opaque"), start=1))
COMPLEX = 0x0800


@dataclass(frozen=True)
class _Element:
    """A variable's place in the file and what its beginning says."""

    path: Path
    start: int
    length: int
    compressed: bool
    name: str
    shape: tuple[int, ...]
    dtype: str

    def read(self) -> np.ndarray:
        """Read this variable alone, in MATLAB's order of axes."""
        from scipy.io import loadmat

        largest = 8 * math.prod(self.shape)
        check_stored(f"'{self.name}' of shape {self.shape}", largest, self.length, compressed=True)
        with self.path.open("rb") as stream:
            header = stream.read(HEADER)
            stream.seek(self.start)
            content = stream.read(8 + self.length)
        suspicious = self.compressed and LARGEST_RATIO * self.length > UNCHECKED
        if suspicious and inflates_beyond(memoryview(content)[8:], largest + BEGINNING):
            raise BadInput(f"'{self.name}' of shape {self.shape} inflates to more than its numbers")
        variables = loadmat(io.BytesIO(header + content))
        return np.asarray(next(value for name, value in variables.items() if not name.startswith("__")))


def matlab5_arrays(path: Path) -> dict[str, StoredArray]:
    """List the variables of a MATLAB file of version 5 to 7, time first: ``(H, W, T)`` becomes ``(T, H, W)``.

    Raises:
        ValueError: damaged or truncated.
    """
    with path.open("rb") as stream:
        return {element.name: _time_first(element) for element in _elements(path, stream)}


def matlab4_arrays(path: Path) -> dict[str, StoredArray]:
    """List the matrices of a MATLAB file of version 4, which knows neither compression nor a third dimension."""
    from scipy.io import loadmat, whosmat

    def stored(name: str, shape: tuple[int, ...], dtype: str) -> StoredArray:
        def read() -> np.ndarray:
            check_stored(f"'{name}' of shape {shape}", math.prod(shape), path.stat().st_size, compressed=False)
            return np.asarray(loadmat(path, variable_names=[name])[name])

        return StoredArray(shape, dtype, dtype not in ("char", "sparse"), read)

    return {name: stored(name, shape, dtype) for name, shape, dtype in whosmat(path)}


def is_matlab4(path: Path) -> bool:
    """Whether the file has no header: one of the first four bytes, text in later versions, is 0."""
    with path.open("rb") as stream:
        return 0 in stream.read(4)


def _time_first(element: _Element) -> StoredArray:
    stacked = len(element.shape) == 3
    shape = (element.shape[2], *element.shape[:2]) if stacked else element.shape
    return StoredArray(
        shape,
        element.dtype,
        element.dtype in NUMBERS,
        lambda: np.moveaxis(array, -1, 0) if (array := element.read()).ndim == 3 else array,
    )


def _elements(path: Path, stream: IO[bytes]) -> Iterator[_Element]:
    end = os.fstat(stream.fileno()).st_size
    header = stream.read(HEADER)
    if len(header) < HEADER or header[126:128] not in (b"IM", b"MI"):
        raise ValueError("no MATLAB header")
    order = "<" if header[126:128] == b"IM" else ">"
    start = HEADER
    while start + 8 <= end:
        stream.seek(start)
        kind, length = struct.unpack(order + "II", stream.read(8))
        if start + 8 + length > end:
            raise ValueError(f"{end} bytes, an element ends at {start + 8 + length}")
        if kind in (COMPRESSED, MATRIX):
            beginning = stream.read(min(length, BEGINNING))
            if kind == COMPRESSED:
                beginning = zlib.decompressobj().decompress(beginning, BEGINNING)[8:]
            if beginning:
                yield _Element(path, start, length, kind == COMPRESSED, *_describe(beginning, order))
        start += 8 + length


def _describe(beginning: bytes, order: str) -> tuple[str, tuple[int, ...], str]:
    """Name, shape and type out of the first bytes of a matrix."""
    (flags,) = struct.unpack_from(order + "I", beginning, 8)
    dimensions, place = _part(beginning, 16, order)
    name, _ = _part(beginning, place, order)
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape, default=-1) < 0:
        raise ValueError(f"a variable of shape {shape}")
    dtype = CLASSES.get(flags & 0xFF, f"class {flags & 0xFF}")
    return name.decode("latin1"), shape, f"complex {dtype}" if flags & COMPLEX else dtype


def _part(content: bytes, place: int, order: str) -> tuple[bytes, int]:
    """The bytes of the part at ``place``, and where the next begins: parts of up to 4 bytes have a short form."""
    (first,) = struct.unpack_from(order + "I", content, place)
    if first >> 16:
        return content[place + 4 : place + 4 + (first >> 16)], place + 8
    (length,) = struct.unpack_from(order + "I", content, place + 4)
    if place + 8 + length > len(content):
        raise ValueError("a variable's name or dimensions are too long")
    return content[place + 8 : place + 8 + length], place + 8 + -(-length // 8) * 8
