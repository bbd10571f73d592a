"""Lateral colour: the relay images two colours of the light at different magnifications."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import PlacementEffect


class LateralColour(PlacementEffect):
    """The mask's image is the mean of two, magnified by 1 + spread and 1 - spread about the centre of the field.

    Args:
        spread: 0 to 0.1.
    """

    name = "lateral_colour"
    rank = 22.2
    about = {"spread": Parameter("1", 0.0, 0, 0.1, step=0.001, starts=(0.004, 0.012, 0.03))}
    sentence = "two colours of the mask's image are magnified by 1 + {spread} and by as much less"
    spread: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_smaller(float(self.spread), size)
