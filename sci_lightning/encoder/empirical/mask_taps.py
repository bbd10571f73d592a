"""Mask taps: the mask's image is smeared by a small free kernel."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import RelayEffect
from sci_lightning.encoder.empirical.empirical import Empirical, window_of_taps


class MaskTaps(Empirical, RelayEffect):
    """Light of every mirror also falls on its neighbours, 5 x 5 but the middle; the scene stays sharp.

    Args:
        count: 24.
        values: the neighbours' shares, row by row.
    """

    name = "mask_taps"
    rank = 27
    where = "the mask's image is smeared"
    number = Parameter("1", 0.0, -1, 1, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 24

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        kernel = window_of_taps(self.coefficients.to(patterns)).flip(-1, -2)
        return torch.nn.functional.conv2d(patterns[:, None], kernel, padding="same")[:, 0]
