"""Raw files of machine-vision cameras: numbers without a header, of whole bytes or packed bit by bit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_memory

COPIES = 16
"""Bytes of memory per pixel while bits are unpacked."""

RAW_FORMATS = {f"Mono{bits}": bits for bits in (8, 10, 12, 14, 16)}
RAW_FORMATS |= {"Mono10p": 10, "Mono12p": 12, "Mono14p": 14, "Mono10Packed": 10, "Mono12Packed": 12}
"""Bits of a pixel, by format: ``Mono12`` takes two bytes, the lower one first; ``Mono12p`` is packed without gaps, the
lowest bit first; ``Mono12Packed`` holds two pixels in three bytes, their lower bits in the middle one.
Source: EMVA, "GenICam Pixel Format Naming Convention", version 2.4."""


class RawLayout(NamedTuple):
    """What a raw file does not say of itself: one of :data:`RAW_FORMATS`, and (H, W) of an image in pixels."""

    format: str
    size: tuple[int, int]

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        return RAW_FORMATS[self.format]


def raw_layout(raw_format: str | None, raw_size: Sequence[int] | None) -> RawLayout | None:
    """Return the layout that two settings state, None if neither is given.

    Raises:
        BadInput: one without the other, or no such format.
    """
    if raw_format is None and raw_size is None:
        return None
    if raw_format is None or raw_size is None:
        raise BadInput("a raw file needs both: raw_format=Mono12p and its height and width, 'raw_size=[H,W]'")
    if raw_format not in RAW_FORMATS:
        raise BadInput(f"raw_format={raw_format}: use one of {', '.join(RAW_FORMATS)}")
    return RawLayout(raw_format, (int(raw_size[0]), int(raw_size[1])))


def read_raw(path: Path, layout: RawLayout) -> np.ndarray:
    """Read ``(N, H, W)``, uint8 or uint16, one image behind the other.

    Raises:
        BadInput: no whole number of images, numbers of more bits than stated, or more than memory allows; without the
            name of the file.
    """
    (height, width), (name, bits) = layout.size, (layout.format, layout.bits)
    size, pixels = path.stat().st_size, height * width
    one = pixels * (1 if bits == 8 else 2)
    if name.endswith("p"):
        one = -(-pixels * bits // 8)
    elif name.endswith("Packed"):
        one = 3 * -(-pixels // 2)
    if not size or size % one:
        raise BadInput(
            f"{size} bytes are no whole number of images of {height} x {width} pixels in {name}, {one} bytes each: "
            "check 'raw_size=[H,W]' and raw_format=, and whether the file begins with a header"
        )
    check_memory("its raw images", COPIES * pixels * (size // one))
    images = np.fromfile(path, np.uint8).reshape(-1, one)
    if name.endswith("p"):
        values = unpacked(images, bits, pixels, "little")
    elif name.endswith("Packed"):
        first, middle, second = np.moveaxis(images.reshape(len(images), -1, 3).astype(np.uint16), -1, 0)
        lowest = 2 ** (bits - 8)
        pairs = np.stack((first * lowest + middle % lowest, second * lowest + (middle >> 4) % lowest), -1)
        values = pairs.reshape(len(images), -1)[:, :pixels]
    else:
        values = images if bits == 8 else images.view("<u2").astype(np.uint16)
    if int(values.max()) >= 2**bits:
        raise BadInput(f"values up to {values.max()} in {name}, whose largest is {2**bits - 1}")
    return values.reshape(-1, height, width)


def unpacked(rows: np.ndarray, bits: int, count: int, order: Literal["little", "big"]) -> np.ndarray:
    """Return the first ``count`` numbers of ``bits`` bits, 1 to 16, in every row of uint8 ``(rows, bytes)``, no gaps.

    ``little``: the lowest bit of bytes and numbers comes first; ``big``: the highest.
    """
    if not 1 <= bits <= 16:
        raise ValueError(f"numbers of {bits} bits, expected 1 to 16")
    values = np.zeros((len(rows), count), np.uint16 if bits > 8 else np.uint8)
    for row, content in zip(values, rows, strict=True):  # one by one: unpacked bits take eight times the memory
        for bit, plane in enumerate(np.unpackbits(content, bitorder=order)[: count * bits].reshape(count, bits).T):
            row |= plane.astype(values.dtype) << (bit if order == "little" else bits - 1 - bit)
    return values
