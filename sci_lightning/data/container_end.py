"""The length that the container of a video file declares, to recognise files that were cut off.

Decoders take a file that was cut off for a shorter video. The outermost parts of a container state their lengths: the
boxes of MP4 and MOV, the RIFF chunks of AVI, the segment of Matroska and WebM. Live recordings leave the length open.
Sources: ISO/IEC 14496-12 (box header), RFC 8794 and RFC 9559 (EBML, Matroska), Microsoft's RIFF.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

BOXES = frozenset(b"ftyp moov mdat free skip wide pnot uuid meta moof mfra sidx ssix styp pdin prft emsg".split())
"""Boxes at the top level of an MP4 or MOV file."""

SEGMENT = 0x18538067
"""Number of the EBML element that holds the content of a Matroska file."""


def declared_bytes(path: Path) -> int:
    """Return how many bytes a video file should have; its own size where the container does not say."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        begin = stream.read(16)
        stream.seek(0)
        read: Callable[[BinaryIO, int], int] | None = None
        if begin[4:8] in BOXES:
            read = _boxes
        elif begin[:4] == b"RIFF":
            read = _riff
        elif begin[:4] == b"\x1a\x45\xdf\xa3":
            read = _matroska
        try:
            return max(size, read(stream, size)) if read else size
        except (struct.error, IndexError):  # cut off within a header
            return size + 1


def _boxes(stream: BinaryIO, size: int) -> int:
    place = 0
    while place < size:
        stream.seek(place)
        length, name = struct.unpack(">I4s", stream.read(8))
        if name not in BOXES:  # a program appended something behind the last box
            return place
        if length == 1:
            (length,) = struct.unpack(">Q", stream.read(8))
        if length == 0:  # to the end of the file
            return size
        if length < 8:
            return place
        place += length
    return place


def _riff(stream: BinaryIO, size: int) -> int:
    place = 0
    while place < size:
        stream.seek(place)
        name, length = struct.unpack("<4sI", stream.read(8))
        if name != b"RIFF" or length in (0, 0xFFFFFFFF):
            return place
        place += 8 + length
    return place


def _matroska(stream: BinaryIO, size: int) -> int:
    place = 0
    while place < size:
        stream.seek(place)
        head = stream.read(12)
        width = _width(head[0])
        identity = int.from_bytes(head[:width], "big")
        length_width = _width(head[width])
        marked = int.from_bytes(head[width : width + length_width], "big")
        length = marked & ((1 << (7 * length_width)) - 1)
        if length == (1 << (7 * length_width)) - 1:  # unknown
            return place
        place += width + length_width + length
        if identity == SEGMENT:
            return place
    return place


def _width(first: int) -> int:
    """Return the number of bytes of an EBML number, from the leading zero bits of its first byte."""
    if first == 0:
        raise IndexError("not an EBML number")
    return 9 - first.bit_length()
