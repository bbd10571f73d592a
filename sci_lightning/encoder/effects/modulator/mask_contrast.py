"""Mask contrast: mirrors that are off still pass some light."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


class MaskContrast(ModulatorEffect):
    r"""Finite contrast: :math:`D = l + (1 - l) M`.

    Args:
        leak: l, the part of the light that a mirror passes when it is off, 0 to 1.
    """

    name = "mask_contrast"
    rank = 13
    about = {"leak": Parameter("1", 0.0, 0, 1, step=0.005, starts=(0.05,))}
    sentence = "closed mirrors let through {leak} of the light"
    leak: torch.Tensor

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        return self.leak + (1 - self.leak) * patterns
