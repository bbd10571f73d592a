"""Mask rotation: the mask's image is turned on the sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import RelayEffect
from sci_lightning.encoder.relay import RelayGeometry


class MaskRotation(RelayEffect):
    """The mask's image is turned about the centre of the field.

    Args:
        angle: degrees, -45 to 45, positive from +x (right) to +y (down): clockwise on the screen.
    """

    name = "mask_rotation"
    rank = 21
    about = {"angle": Parameter("degree", 0.0, -45, 45, step=0.05, starts=(-2.0, -1.0, -0.4, 0.4, 1.0, 2.0))}
    sentence = "the mask's image is turned by {angle} degree"
    angle: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        slope = abs(math.tan(math.radians(float(self.angle))))
        return Border.around(slope * size[1] / 2, slope * size[0] / 2)

    def aim(self, geometry: RelayGeometry) -> RelayGeometry:
        return replace(geometry, angle=torch.deg2rad(self.angle))
