"""The base class of all masks: a module that returns the transmittance of every slot when it is called."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import torch
from torch import nn

from sci_lightning.configuration.bounds import Frames, Pixels, Size
from sci_lightning.errors import BadInput

Start: TypeAlias = Literal["published", "designed"]
"""From which values a mask is learned."""

LARGEST_DESIGN = 16
"""Side of the largest tile that is designed as a whole; larger ones are the repetition of a smaller one."""


class Mask(nn.Module):
    """A mask: ``mask()`` is the transmittance float32 ``(T, H, W)`` in [0, 1] that the scene meets.

    Args:
        frames: T, time slots per snapshot, at least 2.
        size: (H, W) in pixels.
        tile: (h, w) of a smaller pattern that repeats over the mask, or None for a free value in every pixel.
            A tile has fewer values to learn, and every training crop teaches all of them.
        repeat: side of the square of pixels, a superpixel, that has one value: 2 for 2 x 2 pixels, as the paper's
            prototype shows its mask. A size that is no multiple of it cuts the last ones off.

    Raises:
        BadInput: T < 2, a size or tile that is not two positive whole numbers, or a tile of parts of superpixels.
    """

    pattern: torch.Tensor
    """The stored values ``(T, h, w)`` of a mask that is never changed."""

    def __init__(self, frames: Frames, size: Size, tile: Size | None = None, repeat: Pixels = 1) -> None:
        super().__init__()
        if frames < 2:
            raise BadInput(f"frames must be at least 2 (one snapshot codes several frames), got {frames}")
        self.frames = frames
        self.size = _pair("size", size)
        self.tile = self.size if tile is None else _pair("tile", tile)
        self.repeat = repeat
        if isinstance(repeat, bool) or not isinstance(repeat, int) or repeat < 1:
            raise BadInput(f"mask repeat must be a whole number of pixels, 1 or more, got {repeat!r}")
        if self.tile != self.size and any(side % repeat for side in self.tile):
            raise BadInput(f"mask tile={list(self.tile)}: must be multiples of repeat={repeat}, or superpixels are cut")

    @property
    def learned(self) -> bool:
        """Whether training changes the mask."""
        return any(True for _ in self.parameters())

    @property
    def automatic_aperture(self) -> float:
        """The light scale at which an average snapshot of a white scene just reaches full scale."""
        return 1.0

    @property
    def pattern_shape(self) -> tuple[int, int, int]:
        """The shape (T, h, w) of the stored values: those of the tile, or of the whole mask, one per superpixel."""
        return (self.frames, -(-self.tile[0] // self.repeat), -(-self.tile[1] // self.repeat))

    def cover(self, pattern: torch.Tensor) -> torch.Tensor:
        """Repeat a ``(T, h, w)`` pattern of stored values until it covers the mask: ``(T, H, W)``."""
        pattern = self.in_pixels(pattern, 0, 0, *self.tile)
        if self.tile == self.size:
            return pattern
        (height, width), (h, w) = self.size, self.tile
        return pattern.repeat(1, -(-height // h), -(-width // w))[:, :height, :width]

    def in_pixels(self, pattern: torch.Tensor, top: int, left: int, height: int, width: int) -> torch.Tensor:
        """Return ``(T, height, width)`` pixels of a pattern of superpixels, from pixel (top, left) of it on."""
        if self.repeat > 1:
            pattern = pattern.repeat_interleave(self.repeat, -2).repeat_interleave(self.repeat, -1)
        if pattern.shape[-2:] == (height, width):
            return pattern
        return pattern[:, top : top + height, left : left + width]

    def window(self, top: int, left: int, height: int, width: int) -> torch.Tensor:
        """Return the part ``(T, height, width)`` of the mask whose first pixel is (top, left)."""
        return self()[:, top : top + height, left : left + width]

    def designed(self, bits: int, structural: bool, seed: int) -> torch.Tensor:
        """Return a designed real-valued mask of the pattern's shape, see :mod:`~sci_lightning.encoder.mask.design`.

        A mask whose every value is free starts from the repetition of a small designed tile.
        """
        from sci_lightning.encoder.mask.design import TILE, designed_start  # which imports this module

        frames, height, width = self.pattern_shape
        small = max(height, width) <= LARGEST_DESIGN
        tile = (height, width) if small else (min(TILE[0], height), min(TILE[1], width))
        pattern = designed_start(frames, bits, structural, tile, seed)
        return pattern.repeat(1, -(-height // tile[0]), -(-width // tile[1]))[:, :height, :width].clone()

    @torch.no_grad()
    def project_(self) -> None:
        """Clamp the real values from which a learned mask follows to [0, 1]; call after every optimiser step."""
        for values in self.parameters():
            values.clamp_(0, 1)

    def forward(self) -> torch.Tensor:
        return self.cover(self.pattern)

    def extra_repr(self) -> str:
        superpixels = f", repeat={self.repeat}" if self.repeat > 1 else ""
        return f"frames={self.frames}, size={self.size}, tile={self.tile}{superpixels}"


def check_start(start: str) -> bool:
    """Return whether a learned mask starts from a designed one.

    Raises:
        BadInput: another name.
    """
    if start not in ("published", "designed"):
        raise BadInput(f"encoder.mask.start={start}: choose published or designed")
    return start == "designed"


def _pair(name: str, value: Sequence[int]) -> tuple[int, int]:
    pair = tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)
    if len(pair) != 2 or any(not isinstance(side, int) or side < 1 for side in pair):
        raise BadInput(f"{name} must be two positive whole numbers [height, width], got {value!r}")
    return pair[0], pair[1]
