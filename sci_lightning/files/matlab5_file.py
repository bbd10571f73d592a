"""MATLAB's format before 7.3, whose variables are listed without being read.

A file is a header of 128 bytes and elements; each is a type and a length, 4 bytes each, and so many bytes: a matrix,
or the deflated bytes of one. A matrix begins with its flags, dimensions and name.
Source: MathWorks, "MAT-File Format", version 5.
"""

from __future__ import annotations

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
from sci_lightning.files.memory_bound import LARGEST_RATIO, UNCHECKED, check_stored, inflates_beyond
from sci_lightning.files.stored_array import StoredArray

HEADER, COMPRESSED, MATRIX = 128, 15, 14
BEGINNING = 4096
"""Bytes that hold flags, dimensions (32 at most) and name of any variable."""

NUMBERS = ("float64", "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
CLASSES = dict(enumerate(("cell", "struct", "object", "char", "sparse", *NUMBERS, "function", "opaque"), start=1))
COMPLEX, LOGICAL = 0x0800, 0x0200

STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""How an element's numbers are stored, whatever the class of its matrix: doubles that are small and whole as bytes."""

WIDTHS = (8, 4, 4, 2, 2, 1)
"""Bytes of a number by the type's code in version 4."""
SPARSE = 2
MOST_MATRICES = 10_000
"""In a file of version 4."""


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
        """Read this variable alone, in MATLAB's order of axes, as numbers of its class however they are stored."""
        largest = 8 * math.prod(self.shape)
        check_stored(f"'{self.name}' of shape {self.shape}", largest, self.length, compressed=True)
        with self.path.open("rb") as stream:
            order = "<" if stream.read(HEADER)[126:128] == b"IM" else ">"
            stream.seek(self.start + 8)
            content = stream.read(self.length)
        if self.compressed:
            if LARGEST_RATIO * self.length > UNCHECKED and inflates_beyond(content, largest + BEGINNING):
                raise BadInput(f"'{self.name}' of shape {self.shape} inflates to more than its numbers")
            content = zlib.decompress(content)[8:]
        _, place = _part(content, 16, order)
        _, place = _part(content, place, order)
        (kind,) = struct.unpack_from(order + "I", content, place)
        numbers, _ = _part(content, place, order)
        dtype = STORED.get(kind & 0xFFFF if kind >> 16 else kind)
        if dtype is None:  # SciPy would read what is no numbers, and crash over some
            raise ValueError(f"'{self.name}' of class {self.dtype} holds elements of type {kind}, expected numbers")
        values = np.frombuffer(numbers, order + dtype).reshape(self.shape, order="F")
        own = bool if self.dtype == "logical" else self.dtype if self.dtype in NUMBERS else dtype
        return values.astype(own)


def matlab5_arrays(path: Path) -> dict[str, StoredArray]:
    """List the variables of a MATLAB file of version 5 to 7, time first: ``(H, W, T)`` becomes ``(T, H, W)``.

    ``(H, W, 3, T)`` becomes ``(T, 3, H, W)``.

    Raises:
        ValueError: damaged or truncated.
    """
    with path.open("rb") as stream:
        return {element.name: _time_first(element) for element in _elements(path, stream)}


def matlab4_arrays(path: Path) -> dict[str, StoredArray]:
    """List the matrices of a MATLAB file of version 4, which knows neither compression nor a third dimension."""
    from scipy.io import loadmat, whosmat

    _check_matlab4(path)

    def stored(name: str, shape: tuple[int, ...], dtype: str) -> StoredArray:
        def read() -> np.ndarray:
            check_stored(f"'{name}' of shape {shape}", math.prod(shape), path.stat().st_size, compressed=False)
            return np.asarray(loadmat(path, variable_names=[name])[name])

        return StoredArray(shape, dtype, dtype not in ("char", "sparse"), read)

    return {name: stored(name, shape, dtype) for name, shape, dtype in whosmat(path)}


def _check_matlab4(path: Path) -> None:
    """Follow the chain of matrices to the end of the file: SciPy follows one that leads back for ever."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        place, count = 0, 0
        while place < size:
            count += 1
            if count > MOST_MATRICES:
                raise ValueError(f"more than {MOST_MATRICES} matrices")
            stream.seek(place)
            header = stream.read(20)
            order = "<" if 0 <= struct.unpack("<i", header[:4])[0] <= 5000 else ">"
            kind, rows, columns, imaginary, name = struct.unpack(order + "5i", header)
            if not 0 <= kind <= 5000 or min(rows, columns, name) < 0 or kind // 10 % 10 >= len(WIDTHS):
                raise ValueError(f"a matrix of {rows} x {columns} at byte {place}")
            parts = 2 if imaginary == 1 and kind % 10 != SPARSE else 1
            place += 20 + name + parts * rows * columns * WIDTHS[kind // 10 % 10]
        if place > size:
            raise ValueError(f"{size} bytes, a matrix ends at {place}")


def is_matlab4(path: Path) -> bool:
    """Whether the file has no header: one of the first four bytes, text in later versions, is 0."""
    with path.open("rb") as stream:
        return 0 in stream.read(4)


def _time_first(element: _Element) -> StoredArray:
    stacked = len(element.shape) in (3, 4)
    shape = (*element.shape[:1:-1], *element.shape[:2]) if stacked else element.shape
    return StoredArray(
        shape,
        element.dtype,
        element.dtype in (*NUMBERS, "logical"),
        lambda: np.moveaxis(element.read().T, -1, -2) if stacked else element.read(),
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
    dtype = "logical" if flags & LOGICAL else CLASSES.get(flags & 0xFF, f"class {flags & 0xFF}")
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
