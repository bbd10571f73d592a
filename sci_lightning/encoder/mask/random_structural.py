"""Random structural mask (RSw)."""

from __future__ import annotations

import torch

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Seed, Size
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.structure import structure, uniform


class RandomStructural(Mask):
    """A structural mask made of uniform random values and never changed.

    Args:
        bits: mask bit depth, 1 to 8 (1: one open slot per pixel).
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the uniform draw that :func:`~sci_lightning.encoder.mask.structure.structure` makes discrete.
    """

    pattern: torch.Tensor

    def __init__(
        self, bits: Bits, frames: Frames, size: Size, tile: Size | None = None, seed: Seed = 0, repeat: Pixels = 1
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = bits
        self.register_buffer("pattern", structure(uniform(self.pattern_shape, seed), bits))

    def forward(self) -> torch.Tensor:
        return self.cover(self.pattern)
