"""Rolling shutter: rows are exposed one after the other."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.exposure import Exposure


class RollingShutter(ExposureEffect):
    """Row r opens and shuts ``delay * r / (H - 1)`` slots late.

    After the last slot the patterns continue cyclically, and the scene stays at its last frame.

    Args:
        delay: slots between the first and the last row, 0 to 64.
    """

    name = "rolling_shutter"
    rank = 30
    about = {"delay": Parameter("slots", 0.0, 0, 64, step=0.02, starts=(0.2, 0.8, 1.6))}
    sentence = "the last row is exposed {delay} slots after the first"
    delay: torch.Tensor

    def expose(self, exposure: Exposure) -> Exposure:
        count = max(len(exposure.power), exposure.slots + math.ceil(float(self.delay.detach())))
        steps = exposure.power.shape[1]
        longer = replace(exposure, power=torch.ones(count, steps).to(exposure.power))
        opens = self.delay * torch.linspace(0, 1, exposure.rows).to(self.delay)
        middle = longer.times()[..., None]
        seen = torch.minimum(middle + 0.5 / steps, opens + exposure.slots) - torch.maximum(middle - 0.5 / steps, opens)
        return replace(longer, open=(seen * steps).clamp(0, 1))
