"""Mask blur: the mask's image is out of focus, the scene is not."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import PlacementEffect


class MaskBlur(PlacementEffect):
    """The mask's image is blurred by a Gaussian, integrated over square mirrors and pixels.

    Args:
        sigma: standard deviation in pixels, 0 to 8.
    """

    name = "mask_blur"
    rank = 23
    about = {"sigma": Parameter("pixel", 0.0, 0, 8, step=0.03, starts=(0.3, 0.8))}
    sentence = "the mask's image is blurred (sigma {sigma} pixel)"
    sigma: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_blur(float(self.sigma))
