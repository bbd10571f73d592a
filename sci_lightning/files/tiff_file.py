"""Grey pictures out of TIFF files, as cameras, microscopes and imaging programs write them."""

from __future__ import annotations

import logging
import os
import struct
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.memory_bound import (
    LARGEST_RATIO,
    SMALL,
    UNCHECKED,
    check_memory,
    check_stored,
    inflates_beyond,
    readable_bytes,
)
from sci_lightning.files.packed_file import unpacked
from sci_lightning.files.stored_array import readable_shape

MOST_PAGES = 20_000
"""Pages of a TIFF stack, which are looked at one by one. A stack of ImageJ is one page, of any number of pictures."""

LARGEST_PICTURE_RATIO = 100
"""Bytes of pictures of more than :data:`UNCHECKED` bytes per byte that is stored: those of a camera are below 10."""

COPIES = 4
"""Of a compressed picture while it is read: as it comes out, predicted, put together, returned."""

REDUCED, TRANSPARENCY = 1, 4
"""Bits of the tag NewSubfileType: a page is a smaller copy of another one, or says where that one is transparent."""

WHOLE_BYTES = (1, 8, 16, 32, 64)
"""Bits of a sample that tifffile reads by itself."""

BAYER = (
    "a mosaic of colour filters (Bayer): give bayer=rggb (or grbg, gbrg, bggr) to reconstruct it in colour; without it "
    "it is decoded as if it were grey"
)


def read_tiff(path: Path) -> np.ndarray:
    """Read ``(H, W)``, or ``(N, H, W)`` of several pages, with black as 0 and in the type of numbers that the file has.

    Thumbnails are left out, equal colours are one grey channel, and a picture in which white is 0 is inverted. What
    tifffile needs imagecodecs for (LZW, JPEG and others) is read by Pillow where that can.

    Raises:
        BadInput: colour, complex numbers, a compression for which no reader is installed, or more than the file holds
            or the bounds of memory_bound.py allow; without the name of the file.
        Exception: whatever the readers make of a damaged file.
    """
    from tifffile import TiffFile

    _check_pages(path)
    with (
        _silent("tifffile"),
        TiffFile(path, _multifile=False) as file,
    ):  # the metadata of OME and others may name further files
        return _read(path, file)


def _read(path: Path, file: Any) -> np.ndarray:
    from tifffile import COMPRESSION, PHOTOMETRIC

    series = file.series[0] if len(file.series) == 1 else None  # several series: pages that were appended one by one
    pages = list(file.pages) if series else _without_thumbnails(file.pages)
    first = pages[0].keyframe
    if series and len([side for side in series.shape if side > 1]) > (3 if "S" not in series.axes else 4):
        sizes = ", ".join(f"{side} of {axis}" for axis, side in zip(series.axes, series.shape, strict=True))
        raise BadInput(f"one grey channel is expected, this picture is a hyperstack ({sizes}); save one channel of it")
    if first.dtype is not None and first.dtype.kind not in "buif":
        raise BadInput(f"real numbers are expected, this picture holds {first.dtype}")
    declared = series.nbytes if series else sum(page.nbytes for page in pages)
    # a stack of ImageJ has one page, whose numbers are followed by those of the others
    contiguous = series is not None and series.dataoffset is not None
    stored = path.stat().st_size if contiguous else sum(sum(page.databytecounts) for page in pages)
    compressed = any(page.keyframe.compression != 1 for page in pages)
    check_stored(
        f"its picture of shape {series.shape if series else first.shape}",
        declared,
        min(stored, path.stat().st_size),
        compressed=compressed or first.bitspersample % 8 > 0,
    )
    if compressed:
        if declared > max(UNCHECKED, LARGEST_PICTURE_RATIO * sum(sum(page.databytecounts) for page in pages)):
            raise BadInput(
                f"its pictures of {readable_bytes(declared)} are stored in {readable_bytes(path.stat().st_size)}, "
                f"fewer than 1 byte for {LARGEST_PICTURE_RATIO}; save pictures of that size without compression"
            )
        check_memory("its compressed picture", COPIES * declared)
        _check_segments(path, pages)
    if first.photometric == PHOTOMETRIC.CFA:
        warnings.warn(f"{path}: {BAYER}", InputWarning, stacklevel=2)
    axes = series.axes if series else "N" + first.axes
    try:
        if first.bitspersample not in WHOLE_BYTES and not (compressed or first.is_tiled or first.fillorder == 2):
            picture, axes = np.stack([_unpack(path, page) for page in pages]), "NYX"
        elif series:
            picture = series.asarray()
        else:
            picture = np.stack([page.asarray() for page in pages])
    except (ValueError, ImportError, NotImplementedError) as error:
        if "imagecodecs" not in str(error) and not isinstance(error, ImportError):  # of a codec in the library
            raise
        read = _by_pillow(path, pages)
        if read is None:
            name = getattr(COMPRESSION(first.compression), "name", first.compression)
            stated = f"compressed by {name}" if compressed else f"packed as numbers of {first.bitspersample} bits"
            raise BadInput(f"{stated}, which needs pip install imagecodecs, or a copy without compression") from error
        picture, axes = read, "NYX" + "S" * (read.ndim - 3)
    return _grey(path, picture, axes, first)


def _grey(path: Path, picture: np.ndarray, axes: str, page: Any) -> np.ndarray:
    """Return one grey channel, black as 0, of a picture whose samples lie along the axis S, if there is one."""
    from tifffile import PHOTOMETRIC

    kind = getattr(page.photometric, "name", str(page.photometric))
    if "S" in axes:
        # tifffile takes a stack of three or four arrays for the planes of one picture in colour
        is_stack = page.axes == "SYX" and page.is_shaped and picture.size == page.size
        if is_stack and not (picture == np.roll(picture, 1, axes.index("S"))).all():
            line = f"the {page.shape[0]} planes, labelled as colour, are read as a stack of grey pictures"
            warnings.warn(f"{path}: {line}", InputWarning, stacklevel=2)
        else:
            picture = grey_of_colours(np.moveaxis(picture, axes.index("S"), -1), kind)
    elif page.photometric == PHOTOMETRIC.PALETTE:
        colours = page.colormap
        if colours is None or not (colours == colours[:1]).all():
            raise BadInput(f"one grey channel is expected, this picture has a palette of colours ({kind})")
        picture = (colours[0] >> 8).astype(np.uint8)[picture]
    elif page.photometric == PHOTOMETRIC.MINISWHITE:
        if picture.dtype.kind not in "bu":
            raise BadInput(f"white as 0 is expected of whole numbers only, this picture holds {picture.dtype} ({kind})")
        picture = ~picture if picture.dtype.kind == "b" else (2**page.bitspersample - 1) - picture
    elif page.photometric not in (PHOTOMETRIC.MINISBLACK, PHOTOMETRIC.CFA):
        raise BadInput(f"one grey channel with black as 0 is expected, this picture is {page.shape} ({kind})")
    sides = picture.shape[-2:]
    return picture.reshape(sides) if picture.size == sides[0] * sides[1] else picture.reshape(-1, *sides)


def grey_of_colours(colours: np.ndarray, kind: str) -> np.ndarray:
    """Return the one channel of a picture whose colours are equal, as grey cameras' software writes them.

    Args:
        colours: ``(..., S)`` of 1 to 4 samples a pixel; of 2 and 4 the last one may be an even opacity, which is left.
        kind: of the picture, for the message.

    Raises:
        BadInput: the colours differ, or there are more.
    """
    samples = colours.shape[-1]
    if samples in (2, 4) and (colours[..., -1] == colours.flat[samples - 1]).all():
        colours = colours[..., :-1]
    if samples > 4 or not (colours == colours[..., :1]).all():
        raise BadInput(
            f"one grey channel is expected, this picture is {kind} of {samples} channels that differ; save the "
            "camera's raw grey values, or one channel"
        )
    return colours[..., 0]


def _without_thumbnails(pages: Iterable[Any]) -> list[Any]:
    """Return the pages that are pictures of their own, all of one size and type.

    A thumbnail says so in its tags, or has at most half the height and half the width of the largest page.
    """
    own = [page for page in pages if not int(page.subfiletype) & (REDUCED | TRANSPARENCY)] or list(pages)
    height, width = max(((page.imagelength, page.imagewidth) for page in own), key=lambda size: size[0] * size[1])
    own = [page for page in own if 2 * page.imagelength > height or 2 * page.imagewidth > width]
    if len(kinds := {(page.shape, str(page.dtype)): None for page in own}) > 1:
        listed = ", ".join(f"{readable_shape(shape)} of {dtype}" for shape, dtype in list(kinds)[:4])
        raise BadInput(f"pages of one size and type are expected, this file has {listed}; save them as several files")
    return own


def _unpack(path: Path, page: Any) -> np.ndarray:
    """Read an uncompressed page of numbers that do not fill whole bytes; every row begins with a byte of its own."""
    rows, columns, bits = page.imagelength, page.imagewidth, page.bitspersample
    content = b""
    with path.open("rb") as stream:
        for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
            stream.seek(offset)
            content += stream.read(count)
    row = -(-columns * bits // 8)
    if len(content) < rows * row or page.samplesperpixel != 1:
        raise ValueError(f"{len(content)} bytes for {rows} rows of {columns} numbers of {bits} bits")
    return unpacked(np.frombuffer(content, np.uint8, rows * row).reshape(rows, row), bits, columns, "big")


def _by_pillow(path: Path, pages: Sequence[Any]) -> np.ndarray | None:
    """Read pages as ``(N, H, W)`` or ``(N, H, W, S)``; None if Pillow cannot read them, or not with their numbers."""
    from PIL import Image, UnidentifiedImageError

    read = []
    try:
        with Image.open(path, formats=["TIFF"]) as image:
            for page in pages:
                image.seek(page.index)
                read.append(_with_own_numbers(np.asarray(image), page))
    except (UnidentifiedImageError, KeyError):
        return None
    return None if any(one is None for one in read) else np.stack([one for one in read if one is not None])


def _with_own_numbers(read: np.ndarray, page: Any) -> np.ndarray | None:
    """Return what Pillow made of a page in the type and on the scale of the file; None if it is something else."""
    bits, own = page.bitspersample, np.dtype(page.dtype or np.uint16)
    if read.dtype.kind in "iu" and own.kind == "u" and read.dtype.itemsize > own.itemsize:  # Pillow widens some types
        read = read.astype(own)
    if read.shape[:2] != (page.imagelength, page.imagewidth) or read.dtype.newbyteorder("=") != own.newbyteorder("="):
        return None
    if bits in (2, 4):  # Pillow spreads these over the range of 8 bits
        read = read // (255 // (2**bits - 1))
    if int(page.photometric) == 0 and bits <= 8:  # and inverts these, which is done once for all
        return ~read if bits == 1 else (2**bits - 1) - read
    return read


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
