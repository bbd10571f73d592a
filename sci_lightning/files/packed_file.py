"""Raw files of machine-vision cameras: numbers without a header, of whole bytes or packed bit by bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sci_lightning.configuration.bounds import Size
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_memory

COPIES = 16
"""Bytes of memory per pixel while bits are unpacked."""

RAW_FORMATS = {
    **{f"Mono{bits}": bits for bits in (8, 10, 12, 14, 16)},
    **{f"Mono{bits}p": bits for bits in (10, 12, 14)},
    "Mono10Packed": 10,
    "Mono12Packed": 12,
}
"""Bits of a pixel, by format: ``Mono12`` takes two bytes, the lower one first; ``Mono12p`` is packed without gaps, the
lowest bit first; ``Mono12Packed`` holds two pixels in three bytes, their lower bits in the middle one.
Source: EMVA, "GenICam Pixel Format Naming Convention", version 2.4, sections on unpacked, lsb-packed and GigE Vision
packed monochrome formats."""


@dataclass(frozen=True)
class RawLayout:
    """What a raw file does not say of itself.

    Args:
        format: one of :data:`RAW_FORMATS`.
        size: (H, W) of an image in pixels.

    Raises:
        BadInput: no such format.
    """

    format: str
    size: Size

    def __post_init__(self) -> None:
        if self.format not in RAW_FORMATS:
            raise BadInput(f"raw_format={self.format}: use one of {', '.join(RAW_FORMATS)}")

    @property
    def bits(self) -> int:
        """Bits of a pixel."""
        return RAW_FORMATS[self.format]

    @property
    def image_bytes(self) -> int:
        """Bytes of one image."""
        pixels = int(self.size[0]) * int(self.size[1])
        if self.format.endswith("Packed"):
            return 3 * (-(-pixels // 2))
        return -(-pixels * self.bits // 8) if self.format.endswith("p") else pixels * (1 if self.bits == 8 else 2)


def raw_layout(raw_format: str | None, raw_size: Sequence[int] | None) -> RawLayout | None:
    """Return the layout that two settings state, None if neither is given.

    Raises:
        BadInput: one without the other, or no such format.
    """
    if raw_format is None and raw_size is None:
        return None
    if raw_format is None or raw_size is None:
        raise BadInput("a raw file needs both: raw_format=Mono12p and its height and width, 'raw_size=[H,W]'")
    return RawLayout(str(raw_format), (int(raw_size[0]), int(raw_size[1])))


def read_raw(path: Path, layout: RawLayout) -> np.ndarray:
    """Read ``(N, H, W)``, uint8 or uint16, one image behind the other.

    Raises:
        BadInput: no whole number of images, numbers of more bits than stated, or more than memory allows; without the
            name of the file.
        OSError: the file cannot be read.
    """
    size, one = path.stat().st_size, layout.image_bytes
    height, width = layout.size
    if not size or size % one:
        raise BadInput(
            f"{size} bytes are no whole number of images of {height} x {width} pixels in {layout.format}, {one} bytes "
            "each: check raw_size=[H,W] and raw_format=, and whether the file begins with a header"
        )
    pixels = height * width
    check_memory("its raw images", COPIES * pixels * (size // one))
    images = np.fromfile(path, np.uint8).reshape(-1, one)
    if layout.format.endswith("Packed"):
        first, middle, second = np.moveaxis(images.reshape(len(images), -1, 3).astype(np.uint16), -1, 0)
        low = layout.bits - 8
        mask = 2**low - 1
        pairs = (first << low | middle & mask, second << low | middle >> 4 & mask)
        values = np.stack(pairs, -1).reshape(len(images), -1)[:, :pixels]
    elif layout.format.endswith("p"):
        values = unpacked(images, layout.bits, pixels, order="little", most_significant_first=False)
    else:
        values = images if layout.bits == 8 else images.view("<u2").astype(np.uint16)
    if int(values.max()) >= 2**layout.bits:
        raise BadInput(f"values up to {values.max()} in {layout.format}, whose largest is {2**layout.bits - 1}")
    return values.reshape(-1, height, width)


def unpacked(rows: np.ndarray, bits: int, count: int, *, order: str, most_significant_first: bool) -> np.ndarray:
    """Return the first ``count`` numbers of every row of bytes.

    Args:
        rows: uint8 ``(rows, bytes)``.
        bits: of a number, 1 to 16; the numbers follow each other without gaps.
        order: ``little`` if a byte's lowest bit comes first, else ``big``.
        most_significant_first: whether a number's first bit is its highest.

    Returns:
        uint8 or uint16 ``(rows, count)``.

    Raises:
        ValueError: more than 16 bits.
    """
    if not 1 <= bits <= 16:
        raise ValueError(f"numbers of {bits} bits, expected 1 to 16")
    values = np.zeros((len(rows), count), np.uint16 if bits > 8 else np.uint8)
    for row, content in zip(values, rows, strict=True):  # one by one: unpacked bits take eight times the memory
        single = np.unpackbits(content, bitorder="little" if order == "little" else "big")[: count * bits]
        for bit, plane in enumerate(single.reshape(count, bits).T):
            row |= plane.astype(values.dtype) << (bits - 1 - bit if most_significant_first else bit)
    return values
