"""Learned structural mask (LSw)."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Positive, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start, check_start
from sci_lightning.encoder.mask.structure import check_bits, structure, uniform
from sci_lightning.errors import BadInput


class LearnedStructural(Mask):
    """A real-valued mask that is learned, and the structural mask derived from it in every forward pass.

    The parameter is ``weight``, the real-valued mask: it is what the optimiser moves, what the checkpoint keeps and
    what data-parallel processes share; the discrete mask is never stored. It starts as a power of uniform values.

    Args:
        bits: mask bit depth, 1 to 8 (1: one open slot per pixel).
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the initial real-valued mask.
        sharpness: the power, > 0. 1 is the published start. With a larger power the light of a pixel falls into fewer
            slots at the start; a decoder learns to undo such a mask in fewer steps, and training can soften it again.
        start: ``published`` for uniform values; ``designed`` for the mask that
            :func:`~sci_lightning.encoder.mask.design.design_structural` finds in seconds, whatever the sharpness.

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
        if not sharpness > 0:
            raise BadInput(f"mask sharpness must be positive, got {sharpness!r}")
        self.bits = check_bits(bits)
        first = (
            self.designed(bits, True, seed) if check_start(start) else uniform(self.pattern_shape, seed) ** sharpness
        )
        self.weight = nn.Parameter(first)

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
