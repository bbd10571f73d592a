"""Scene shift: the target is displaced."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect, resampled
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.relay.mask_shift import MaskShift


class SceneShift(SceneEffect):
    """All targets lie ``dx`` to the right of and ``dy`` below where the file says; even scenes do not change.

    Args:
        dx, dy: displacement in pixels, +x right and +y down, -32 to 32.
    """

    name = "scene_shift"
    rank = 5
    displacement = ("dx", "dy")
    about = MaskShift.about
    sentence = "the targets are displaced by ({dx}, {dy}) pixel"
    dx: torch.Tensor
    dy: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_displacement(float(self.dx), float(self.dy))

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        if scene.shape[-2:] == (1, 1):
            return scene
        rows, columns = (torch.arange(length).to(scene) for length in scene.shape[-2:])
        return resampled(scene, (rows - self.dy)[:, None], (columns - self.dx)[None])
