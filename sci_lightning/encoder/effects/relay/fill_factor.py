"""Fill factor: the mirrors of the modulator do not touch."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import RelayEffect
from sci_lightning.encoder.relay import RelayGeometry


class FillFactor(RelayEffect):
    """Mirrors are squares with dark gaps between them, and as bright, all together, as touching ones.

    Gaps show where the mask's image is displaced, turned, magnified or blurred: a displacement smaller than half a gap
    does nothing. Every modulator has them, so that no camera is blamed for them.

    Args:
        fraction: part of a mirror's cell that reflects, 0.5 to 1.
    """

    name = "fill_factor"
    rank = 22.1
    about = {"fraction": Parameter("1", 1.0, 0.5, 1, step=0.02, starts=(0.9,))}
    imperfection = True
    sentence = "mirrors fill {fraction} of their cells"
    fraction: torch.Tensor

    def aim(self, geometry: RelayGeometry) -> RelayGeometry:
        return replace(geometry, fill=self.fraction)
