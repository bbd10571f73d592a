"""Random structural mask (RSw)."""

from __future__ import annotations

import torch

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Positive, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start
from sci_lightning.encoder.mask.structure import structure


class RandomStructural(Mask):
    """A structural mask that is never changed: exactly the start of a learned one of the same settings and seed.

    Args:
        bits: mask bit depth, 1 to 8 (1: one open slot per pixel).
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the real values that :func:`~sci_lightning.encoder.mask.structure.structure` makes discrete.
        sharpness, start: see :meth:`~sci_lightning.encoder.mask.Mask.structural_start`; the paper's random masks have
            sharpness 1 and the published start.
    """

    pattern: torch.Tensor

    def __init__(
        self,
        bits: Bits,
        frames: Frames,
        size: Size,
        tile: Size | None = None,
        seed: Seed = 0,
        repeat: Pixels = 1,
        sharpness: Positive = 1.0,
        start: Start = "published",
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = bits
        self.register_buffer("pattern", structure(self.structural_start(bits, seed, sharpness, start), bits))

    def forward(self) -> torch.Tensor:
        return self.cover(self.pattern)
