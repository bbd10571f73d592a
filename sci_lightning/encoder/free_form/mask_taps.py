"""Mask taps: the mask's image is smeared by a small free kernel."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.stage import RelayEffect
from sci_lightning.encoder.free_form.free_form import NeighbourTaps


class MaskTaps(NeighbourTaps, RelayEffect):
    """The light of every mirror also falls on its neighbours; the scene stays sharp. See :class:`NeighbourTaps`."""

    name = "mask_taps"
    rank = 27
    where = "the mask's image is smeared"

    def show(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        return self.smear(patterns, cells)
