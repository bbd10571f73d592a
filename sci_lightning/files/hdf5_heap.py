"""The part of an HDF5 file that holds strings, checked before the HDF5 library reads it.

A global heap is a chain of objects, each with its length; at a length of 0 or one that wraps around, HDF5 2.0 reads the
same object for ever and cannot be interrupted.
Source: The HDF Group, "HDF5 File Format Specification", III.E, "Disk Format: Level 1E - Global Heap".
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.errors import BadInput

if TYPE_CHECKING:
    import h5py

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


def longest_string(path: Path, attribute: str) -> int:
    """Return the length that an attribute of variable length declares, in bytes; of several of that name the longest.

    HDF5 allocates so many bytes, up to 4 GiB, before it looks for the string.
    Source: as above, IV.A.2.m, "The Attribute Message", versions 1 to 3.
    """
    name, longest = attribute.encode() + b"\0", 0
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        place = content.find(name)
        while place >= 0:
            for version, header in ((1, 8), (2, 8), (3, 9)):  # version, flags, three sizes; version 3: an encoding
                if place < header or content[place - header] != version:
                    continue
                sizes = struct.unpack_from("<3H", content, place - header + 2)
                data = place + sum(-(-size // 8) * 8 if version == 1 else size for size in sizes)
                if sizes[0] >= len(name) and data + 4 <= len(content):
                    longest = max(longest, *struct.unpack_from("<I", content, data))
            place = content.find(name, place + 1)
    return longest


def longest_strings(path: Path, item: h5py.Dataset) -> int | None:
    """Return the greatest length that the strings of variable length in a dataset declare, in bytes.

    Returns:
        None where that cannot be seen: stored in the header of the dataset, or compressed.
    """
    plist = item.id.get_create_plist()
    if item.chunks is None:
        offset = item.id.get_offset()
        if offset is None:
            return None if item.id.get_storage_size() else 0
        with path.open("rb") as stream:
            stream.seek(offset)
            return _longest(stream.read(item.id.get_storage_size()))
    if plist.get_nfilters():
        return None
    chunks = []
    item.id.chunk_iter(lambda chunk: chunks.append(chunk.chunk_offset))
    return max((_longest(item.id.read_direct_chunk(chunk)[1]) for chunk in chunks), default=0)


def _longest(references: bytes) -> int:
    """Of references to strings: length, address of the heap, number of the object, in 4, 8 and 4 bytes."""
    return max(
        (length for (length,) in struct.iter_unpack("<I12x", references[: len(references) // 16 * 16])), default=0
    )
