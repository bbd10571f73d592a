"""Ideal sensor (oSR): no response."""

from __future__ import annotations

import torch

from sci_lightning.encoder.sensor.sensor import Sensor


class Ideal(Sensor):
    """Returns the light ``(N, H, W)`` as it is: no clipping, no rounding, no noise."""

    def forward(self, light: torch.Tensor, bits: int | None = None) -> torch.Tensor:
        return light
