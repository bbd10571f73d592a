"""Learned binary mask."""

from __future__ import annotations

import torch

from sci_lightning.encoder.mask.learned_one_bit import LearnedOneBit
from sci_lightning.encoder.mask.structure import uniform
from sci_lightning.encoder.rounding import round_half_up, straight_through


class LearnedBinary(LearnedOneBit):
    """A real-valued mask that is learned; a slot is open where it is at least 1/2 (straight-through gradient).

    The sum over time is not constrained: how much light a pixel collects is learned as well. The published start is
    uniform in [0, 1), so that half of the slots start open; the designed one is the mask that
    :func:`~sci_lightning.encoder.mask.design.design_binary` finds in seconds.

    Args: see :class:`~sci_lightning.encoder.mask.learned_one_bit.LearnedOneBit`.

    Source: Hubara et al., "Binarized neural networks" (2016), as the paper's related work uses it.
    """

    def first_values(self, seed: int, designed: bool) -> torch.Tensor:
        return self.designed(1, False, seed) if designed else uniform(self.pattern_shape, seed)

    @property
    def automatic_aperture(self) -> float:
        """2/T, as for a random binary mask, so that both see the same light."""
        return 2 / self.frames

    def forward(self) -> torch.Tensor:
        return self.cover(straight_through(round_half_up(self.weight), self.weight))
