"""Mask scale: the mask's image has another size on the sensor."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import PlacementEffect


class MaskScale(PlacementEffect):
    """The mask's image is magnified about the centre of the field; its brightness does not change.

    Args:
        scale: 0.5 to 2; above 1 the image is larger.
    """

    name = "mask_scale"
    rank = 22
    about = {"scale": Parameter("1", 1.0, 0.5, 2, step=0.001, starts=(0.97, 0.985, 0.994, 1.006, 1.015, 1.03))}
    sentence = "the mask's image is {scale} times as large as it should be"
    scale: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_smaller(1 - float(self.scale), size)
