"""Mask shift: the mask's image is displaced on the sensor."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import PlacementEffect

STARTS = (-1.2, -0.4, 0.0, 0.4, 1.2)


class MaskShift(PlacementEffect):
    """The mask's image has moved; a fraction of a pixel is the exact overlap of square mirrors with pixels.

    Args:
        dx, dy: displacement in pixels, +x right and +y down, -32 to 32. What enters from outside the mask is dark.
    """

    name = "mask_shift"
    rank = 20
    displacement = ("dx", "dy")
    about = {name: Parameter("pixel", 0.0, -32, 32, step=0.1, starts=STARTS) for name in ("dx", "dy")}
    sentence = "the mask's image is displaced by ({dx}, {dy}) pixel"
    dx: torch.Tensor
    dy: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_displacement(float(self.dx), float(self.dy))
