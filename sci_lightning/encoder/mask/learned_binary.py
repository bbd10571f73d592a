"""Learned binary mask."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start, check_start
from sci_lightning.encoder.mask.structure import check_binary, uniform
from sci_lightning.encoder.rounding import round_half_up, straight_through


class LearnedBinary(Mask):
    """A real-valued mask that is learned; a slot is open where it is at least 1/2 (straight-through gradient).

    The sum over time is not constrained: how much light a pixel collects is learned as well.

    Args:
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the initial real-valued mask, uniform in [0, 1): half of the slots start open.
        bits: mask bit depth, always 1: it is there so that a sweep over bits can name every mask.
        start: ``published`` for uniform values; ``designed`` for the mask that
            :func:`~sci_lightning.encoder.mask.design.design_binary` finds in seconds.

    Raises:
        BadInput: ``bits`` other than 1.

    Source: Hubara et al., "Binarized neural networks" (2016), as the paper's related work uses it.
    """

    learned = True

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
        first = self.designed(1, False, seed) if check_start(start) else uniform(self.pattern_shape, seed)
        self.weight = nn.Parameter(first)

    @property
    def automatic_aperture(self) -> float:
        """2/T, as for a random binary mask, so that both see the same light."""
        return 2 / self.frames

    @torch.no_grad()
    def project_(self) -> None:
        """Clamp the real-valued mask to [0, 1]; call after every optimiser step."""
        self.weight.clamp_(0, 1)

    def forward(self) -> torch.Tensor:
        return self.cover(straight_through(round_half_up(self.weight), self.weight))
