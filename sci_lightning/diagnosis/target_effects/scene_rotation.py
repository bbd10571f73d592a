"""Scene rotation: the target is turned."""

from __future__ import annotations

import math

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect, from_centre, resampled
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter


class SceneRotation(SceneEffect):
    """All targets are turned about the centre of the field; even scenes do not change.

    Args:
        angle: degrees, -45 to 45, positive from +x (right) to +y (down): clockwise on the screen.
    """

    name = "scene_rotation"
    rank = 4
    about = {"angle": Parameter("degree", 0.0, -45, 45, step=0.05, starts=(-1.2, -0.4, 0.4, 1.2))}
    sentence = "the targets are turned by {angle} degree"
    angle: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        slope = abs(math.tan(math.radians(float(self.angle))))
        return Border.around(slope * size[1] / 2, slope * size[0] / 2)

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        if scene.shape[-2:] == (1, 1):
            return scene
        y, x = from_centre(scene)
        cos, sin = torch.cos(torch.deg2rad(self.angle)), torch.sin(torch.deg2rad(self.angle))
        height, width = scene.shape[-2:]
        return resampled(scene, cos * y - sin * x + (height - 1) / 2, cos * x + sin * y + (width - 1) / 2)
