"""One grey picture, or several, out of a TIFF, PNG, NPY, MAT or HDF5 file, with the numbers as they are stored."""

from __future__ import annotations

import logging
import os
import struct
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import ENDINGS, read_array
from sci_lightning.files.memory_bound import (
    LARGEST_RATIO,
    SMALL,
    UNCHECKED,
    check_memory,
    check_stored,
    inflates_beyond,
    readable_bytes,
)

PICTURES = (".tif", ".tiff", ".png")
MOST_PAGES = 20_000
"""Pages of a TIFF stack, which are looked at one by one. A stack of ImageJ is one page, of any number of pictures."""

LARGEST_PICTURE_RATIO = 100
"""Bytes of pictures of more than :data:`UNCHECKED` bytes per byte that is stored: those of a camera are below 10."""

COPIES = 4
"""Of a compressed picture while it is read: as it comes out, predicted, put together, returned."""


def read_pictures(path: str | Path, *, prefer: str, key: str | None = None, setting: str = "") -> np.ndarray:
    """Read ``(H, W)``, or ``(N, H, W)`` of a TIFF stack or a file of arrays (``(H, W, N)`` in a MAT file).

    Args:
        path: .tif, .tiff, .png or one of :data:`~sci_lightning.files.array_file.ENDINGS`.
        prefer, key, setting: name of the array, see :func:`~sci_lightning.files.array_file.read_array`.

    Returns:
        Numbers of the type that the file has.

    Raises:
        BadInput: missing or unreadable file, unknown ending, colour, complex numbers, white as 0, no such array, more
            than the file holds or than the bounds of memory_bound.py allow.
    """
    path = Path(path)
    if path.suffix.lower() in ENDINGS:
        return read_array(path, key=key, prefer=prefer, dimensions=(3, 2), setting=setting)
    if path.is_dir():
        raise BadInput(f"{path}: is a folder, expected a file")
    if path.suffix.lower() not in PICTURES:
        raise BadInput(
            f"{path}: cannot read a picture from '{path.suffix}'; use one of {', '.join(PICTURES + ENDINGS)}"
        )
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    try:
        picture = _tiff(path) if path.suffix.lower() != ".png" else _png(path)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error
    except Exception as error:  # every format has errors of its own
        reason = " ".join(str(error).split())[:200]
        reason = f"{type(error).__name__}: {reason}" if reason else type(error).__name__
        raise BadInput(f"{path}: not a readable picture, damaged or truncated ({reason})") from error
    if picture.ndim not in (2, 3) or picture.size == 0:
        raise BadInput(f"{path}: one grey channel is expected, this picture is {picture.shape}")
    if picture.dtype.kind not in "buif":
        raise BadInput(f"{path}: real numbers are expected, this picture holds {picture.dtype}")
    return picture


def _tiff(path: Path) -> np.ndarray:
    """Read a TIFF; not with scikit-image, which takes a stack of three or four pages for one picture in colour."""
    from tifffile import PHOTOMETRIC, TiffFile

    _check_pages(path)
    with (
        _silent("tifffile"),
        TiffFile(path, _multifile=False) as file,
    ):  # the metadata of OME and others may name further files
        first = file.pages.first
        grey = (PHOTOMETRIC.MINISBLACK, PHOTOMETRIC.CFA)
        if first.samplesperpixel > 1 or first.photometric not in grey:
            kind = getattr(first.photometric, "name", first.photometric)
            stack = len(first.shape) == 3 and first.shape[0] in (3, 4)  # some writers take so many grey pages for RGB
            grey_pages = "; grey pages that are labelled as colour? Save them with photometric='minisblack'"
            raise BadInput(
                f"one grey channel with black as 0 is expected, this picture is {first.shape} ({kind})"
                f"{grey_pages if stack else ''}"
            )
        if first.dtype is None or first.dtype.kind not in "buif":
            raise BadInput(f"real numbers are expected, this picture holds {first.dtype or 'an unknown type'}")
        one = len(file.series) == 1  # several series: pages that were appended one by one
        declared = file.series[0].nbytes if one else sum(page.nbytes for page in file.pages)
        # a stack of ImageJ has one page, whose numbers are followed by those of the others
        contiguous = one and file.series[0].dataoffset is not None
        stored = path.stat().st_size if contiguous else sum(sum(page.databytecounts) for page in file.pages)
        compressed = any(page.keyframe.compression != 1 for page in file.pages)
        expands = first.bitspersample % 8 > 0
        check_stored(
            f"its picture of shape {file.series[0].shape}",
            declared,
            min(stored, path.stat().st_size),
            compressed=compressed or expands,
        )
        if compressed:
            if declared > max(UNCHECKED, LARGEST_PICTURE_RATIO * sum(sum(page.databytecounts) for page in file.pages)):
                raise BadInput(
                    f"its pictures of {readable_bytes(declared)} are stored in {readable_bytes(path.stat().st_size)}, "
                    f"fewer than 1 byte for {LARGEST_PICTURE_RATIO}; save pictures of that size without compression"
                )
            check_memory("its compressed picture", COPIES * declared)
            _check_segments(path, file.pages)
        return np.asarray(file.asarray() if one else file.asarray(key=slice(None)))


def _check_pages(path: Path) -> None:
    """Follow the chain of a TIFF's pages to its end: tifffile takes a chain that leads out of the file for ended."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(16)
        order = "<" if head[:2] == b"II" else ">"
        big = struct.unpack(order + "H", head[2:4]) == (43,)
        entry, count, offset = (20, "Q", "Q") if big else (12, "H", "I")
        (place,) = struct.unpack_from(order + offset, head, 8 if big else 4)
        pages = 0
        while place:
            pages += 1
            if pages > MOST_PAGES:
                raise BadInput(
                    f"more than {MOST_PAGES} pages, or pages that follow each other in a circle; save them as several "
                    "files, or as one .npy"
                )
            stream.seek(place)
            (entries,) = struct.unpack(order + count, stream.read(struct.calcsize(count)))
            stream.seek(entry * entries, os.SEEK_CUR)
            (place,) = struct.unpack(order + offset, stream.read(struct.calcsize(offset)))
            if place >= size:
                raise BadInput(f"page {pages + 1} lies at byte {place} of {size}, damaged or truncated")


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Keep a library from logging what is raised as an error anyway."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)


def _check_segments(path: Path, pages: Iterable[Any]) -> None:
    """Strips and tiles that are compressed by deflate inflate to whatever comes out of them: no more than a page."""
    with path.open("rb") as stream:
        for page in pages:
            for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False):
                if LARGEST_RATIO * count > UNCHECKED:
                    stream.seek(offset)
                    if inflates_beyond(stream.read(count), 2 * page.nbytes + SMALL):
                        raise BadInput(f"a part of the picture inflates to more than its shape {page.shape}")


def _png(path: Path) -> np.ndarray:
    """Read a PNG, of 1, 2, 4, 8 or 16 bits, with the numbers that it stores."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        image = Image.open(path, formats=["PNG"])
    with image:
        if image.mode not in ("1", "L", "I;16", "I;16B", "I"):
            raise BadInput(f"one grey channel is expected, this picture is {image.mode} of {image.size}")
        with path.open("rb") as stream:
            bits = stream.read(25)[24]  # of the header, which comes first
        picture = np.asarray(image)
    if bits in (2, 4):  # Pillow spreads these over the range of 8 bits
        return picture // (255 // (2**bits - 1))
    return picture.astype(np.uint16) if bits == 16 else picture
