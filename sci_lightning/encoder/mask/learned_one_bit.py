"""The base class of learned masks of 1 bit."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start, check_start
from sci_lightning.encoder.mask.structure import check_binary


class LearnedOneBit(Mask):
    """A mask of slots that are open or shut, which follow in every forward pass from real values that are learned.

    Args:
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the first real values.
        bits: mask bit depth, always 1: it is there so that a sweep over bits can name every mask.
        start: ``published`` for random values; ``designed`` for a mask that is found in seconds.

    Raises:
        BadInput: ``bits`` other than 1, or another start.
    """

    def __init__(
        self,
        frames: Frames,
        size: Size,
        tile: Size | None = None,
        seed: Seed = 0,
        bits: Bits = 1,
        repeat: Pixels = 1,
        start: Start = "published",
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = check_binary(bits)
        self.weight = nn.Parameter(self.first_values(seed, check_start(start)))

    def first_values(self, seed: int, designed: bool) -> torch.Tensor:
        """Return the real values in [0, 1] from which learning starts."""
        raise NotImplementedError
