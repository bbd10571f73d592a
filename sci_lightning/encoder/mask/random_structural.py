"""Random structural mask (RSw)."""

from __future__ import annotations

import torch

from sci_lightning.encoder.mask.structural import Structural
from sci_lightning.encoder.mask.structure import structure


class RandomStructural(Structural):
    """A structural mask that is never changed: exactly the start of a learned one of the same settings and seed.

    Args: see :class:`~sci_lightning.encoder.mask.structural.Structural`; the paper's random masks have sharpness 1 and
        the published start.
    """

    def keep(self, real: torch.Tensor) -> None:
        self.register_buffer("pattern", structure(real, self.bits))
