"""Learned structural mask (LSw)."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.encoder.mask.structural import Structural
from sci_lightning.encoder.mask.structure import structure


class LearnedStructural(Structural):
    """A real-valued mask that is learned, and the structural mask derived from it in every forward pass.

    The parameter is ``weight``, the real-valued mask: it is what the optimiser moves, what the checkpoint keeps and
    what data-parallel processes share; the discrete mask is never stored.

    Args: see :class:`~sci_lightning.encoder.mask.structural.Structural`.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Algorithm 1.
    """

    def keep(self, real: torch.Tensor) -> None:
        self.weight = nn.Parameter(real)

    def forward(self) -> torch.Tensor:
        return self.cover(structure(self.weight, self.bits))

    def window(self, top: int, left: int, height: int, width: int) -> torch.Tensor:
        if self.tile != self.size:  # a tile is structured faster than what it covers
            return super().window(top, left, height, width)
        r = self.repeat
        rows, columns = (slice(at // r, -(-(at + side) // r)) for at, side in ((top, height), (left, width)))
        part = structure(self.weight[:, rows, columns], self.bits)
        return self.in_pixels(part, top % r, left % r, height, width)
