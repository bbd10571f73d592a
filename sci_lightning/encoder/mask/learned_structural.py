"""Learned structural mask (LSw)."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Positive, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start
from sci_lightning.encoder.mask.structure import check_bits, structure


class LearnedStructural(Mask):
    """A real-valued mask that is learned, and the structural mask derived from it in every forward pass.

    The parameter is ``weight``, the real-valued mask: it is what the optimiser moves, what the checkpoint keeps and
    what data-parallel processes share; the discrete mask is never stored. It starts as a power of uniform values.

    Args:
        bits: mask bit depth, 1 to 8 (1: one open slot per pixel).
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the initial real-valued mask.
        sharpness, start: see :meth:`~sci_lightning.encoder.mask.Mask.structural_start`; training can soften a sharp
            start again.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Algorithm 1.
    """

    learned = True

    def __init__(
        self,
        bits: Bits,
        frames: Frames,
        size: Size,
        tile: Size | None = None,
        seed: Seed = 0,
        sharpness: Positive = 1.0,
        repeat: Pixels = 1,
        start: Start = "published",
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = check_bits(bits)
        self.weight = nn.Parameter(self.structural_start(bits, seed, sharpness, start))

    @torch.no_grad()
    def project_(self) -> None:
        """Clamp the real-valued mask to [0, 1]; call after every optimiser step."""
        self.weight.clamp_(0, 1)

    def forward(self) -> torch.Tensor:
        return self.cover(structure(self.weight, self.bits))

    def window(self, top: int, left: int, height: int, width: int) -> torch.Tensor:
        if self.tile != self.size:  # a tile is structured faster than what it covers
            return super().window(top, left, height, width)
        r = self.repeat
        rows, columns = (slice(at // r, -(-(at + side) // r)) for at, side in ((top, height), (left, width)))
        part = structure(self.weight[:, rows, columns], self.bits)
        return self.in_pixels(part, top % r, left % r, height, width)
