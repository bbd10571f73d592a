"""The part of an HDF5 file that holds strings, checked before the HDF5 library reads it.

A global heap is a chain of objects, each with its length; at a length of 0 or one that wraps around, HDF5 2.0 reads the
same object for ever and cannot be interrupted.
Source: The HDF Group, "HDF5 File Format Specification", III.E, "Disk Format: Level 1E - Global Heap".
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from sci_lightning.errors import BadInput

SIGNATURE = b"GCOL\x01\x00\x00\x00"
HEADER = 16
"""Bytes of the header of a heap and of each object, whose lengths have 4 or 8 bytes."""

MOST_OBJECTS = 1_000_000


def check_heaps(path: Path, length_bytes: int) -> None:
    """Check that every chain of objects of every global heap of a file comes to its end.

    Args:
        path: the HDF5 file.
        length_bytes: of lengths in this file.

    Raises:
        BadInput: an object that is too short or too long, or more than :data:`MOST_OBJECTS`.
    """
    length = struct.Struct({2: "<H", 4: "<I"}.get(length_bytes, "<Q"))
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        objects, heap = 0, content.find(SIGNATURE)
        while heap >= 0 and heap + HEADER <= len(content):
            (size,) = length.unpack_from(content, heap + 8)
            place, end = heap + HEADER, min(heap + size, len(content))
            while place + HEADER <= end:
                (index,) = struct.unpack_from("<H", content, place)
                (size,) = length.unpack_from(content, place + 8)
                need = HEADER + -(-size // 8) * 8 if index else size  # 0: the free space at the end, header included
                objects += 1
                if need < HEADER or need > end - place + 8 or objects > MOST_OBJECTS:
                    raise BadInput(f"its strings are damaged (an object of {size} bytes at byte {place})")
                place += need
            heap = content.find(SIGNATURE, heap + 1)
