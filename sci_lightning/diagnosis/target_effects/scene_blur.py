"""Scene blur: the target is less sharp than the file states."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect, blurred
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter


class SceneBlur(SceneEffect):
    """All targets are blurred by a Gaussian; even scenes do not change.

    A file states means over pixels. What the target shows within them is unknown, and a target that is resampled or
    displaced looks blurred by a tenth of a pixel for that alone.

    Args:
        sigma: standard deviation in pixels, 0 to 8.
    """

    name = "scene_blur"
    rank = 2
    about = {"sigma": Parameter("pixel", 0.0, 0, 8, step=0.03, inexact=0.06, starts=(0.3, 0.8))}
    sentence = "the targets are blurred (sigma {sigma} pixel)"
    sigma: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_blur(float(self.sigma))

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        return scene if scene.shape[-2:] == (1, 1) else blurred(scene, self.sigma)
