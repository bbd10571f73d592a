"""Scene gamma: the target's brightness is a power of what the file says."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect
from sci_lightning.encoder.effects.parameter import Parameter


class SceneGamma(SceneEffect):
    r"""All scenes, even ones too, are shown as :math:`x^\gamma`, as by a display with another gamma than assumed.

    Args:
        gamma: 0.1 to 10.
    """

    name = "scene_gamma"
    rank = 1
    about = {"gamma": Parameter("1", 1.0, 0.1, 10, step=0.01, starts=(0.8, 1.25))}
    sentence = "the targets show a brightness as its power of {gamma}"
    gamma: torch.Tensor

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        return torch.where(scene > 0, scene.clamp(min=1e-6) ** self.gamma, scene)
