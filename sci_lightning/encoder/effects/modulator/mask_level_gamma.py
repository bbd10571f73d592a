"""Mask level gamma: gray levels of the mask are displayed with another brightness."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


class MaskLevelGamma(ModulatorEffect):
    r"""The displayed transmittance is a power of the commanded one: :math:`D = M^\gamma`. Binary masks do not change.

    Args:
        gamma: 0.1 to 10.
    """

    name = "mask_level_gamma"
    rank = 12
    about = {"gamma": Parameter("1", 1.0, 0.1, 10, step=0.02, starts=(0.8, 1.25))}
    sentence = "the modulator displays a level as its power of {gamma}"
    gamma: torch.Tensor

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        return torch.where(patterns > 0, patterns.clamp(min=1e-6) ** self.gamma, patterns)
