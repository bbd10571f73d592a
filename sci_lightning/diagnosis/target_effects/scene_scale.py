"""Scene scale: the target has another size."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect, from_centre, resampled
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter


class SceneScale(SceneEffect):
    """All targets are magnified about the centre of the field; even scenes do not change.

    Args:
        scale: 0.5 to 2; above 1 the targets are larger.
    """

    name = "scene_scale"
    rank = 3
    about = {"scale": Parameter("1", 1.0, 0.5, 2, step=0.001, starts=(0.97, 0.99, 1.01, 1.03))}
    sentence = "the targets are {scale} times as large as they should be"
    scale: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        smaller = max(1 - float(self.scale), 0.0)
        return Border.around(smaller * size[0] / 2, smaller * size[1] / 2)

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        if scene.shape[-2:] == (1, 1):
            return scene
        y, x = from_centre(scene)
        height, width = scene.shape[-2:]
        return resampled(scene, y / self.scale + (height - 1) / 2, x / self.scale + (width - 1) / 2)
