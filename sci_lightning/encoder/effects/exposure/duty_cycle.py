"""Duty cycle: patterns are shown for a part of their slots only."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.exposure import Exposure


class DutyCycle(ExposureEffect):
    """Every slot is lit from its start for a part of its time, and dark until the next pattern is shown.

    Under steady light and with all rows open together it is the same as a smaller ``gain``.

    Args:
        fraction: the part of every slot during which its pattern is shown, 0.01 to 1.
    """

    name = "duty_cycle"
    rank = 32
    about = {"fraction": Parameter("1", 1.0, 0.01, 1, step=0.01, starts=(0.9,))}
    sentence = "every pattern is shown for {fraction} of its slot"
    plainer: ClassVar[str | None] = "gain"
    fraction: torch.Tensor

    def expose(self, exposure: Exposure) -> Exposure:
        steps = exposure.power.shape[1]
        shown = (self.fraction * steps - torch.arange(steps).to(self.fraction)).clamp(0, 1)
        return replace(exposure, power=exposure.power * shown)
