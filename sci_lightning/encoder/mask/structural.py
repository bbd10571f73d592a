"""The base class of structural masks, learned or not."""

from __future__ import annotations

import torch

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Positive, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start, check_start
from sci_lightning.encoder.mask.structure import check_bits, uniform
from sci_lightning.errors import BadInput


class Structural(Mask):
    """A mask of discrete levels that sum to 1 over time, made of a real-valued mask by Algorithm 1 of the paper.

    Args:
        bits: mask bit depth, 1 to 8 (1: one open slot per pixel).
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the real-valued mask.
        sharpness: the power of uniform values that the real-valued mask is, > 0. 1 is the published start. With a
            larger power the light of a pixel falls into fewer slots; a decoder learns to undo such a mask in fewer
            steps, and training can soften it again.
        start: ``published`` for these; ``designed`` for the mask that
            :func:`~sci_lightning.encoder.mask.design.design_structural` finds in seconds, whatever the sharpness.

    Raises:
        BadInput: bits outside of 1 to 8, a sharpness that is not positive, or another start.
    """

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
        if not sharpness > 0:
            raise BadInput(f"mask sharpness must be positive, got {sharpness!r}")
        designed = check_start(start)
        self.keep(self.designed(bits, True, seed) if designed else uniform(self.pattern_shape, seed) ** sharpness)

    def keep(self, real: torch.Tensor) -> None:
        """Take the real-valued mask ``(T, h, w)`` in [0, 1]."""
        raise NotImplementedError
