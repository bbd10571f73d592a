"""The base class of all sensors."""

from __future__ import annotations

import torch
from torch import nn


class Sensor(nn.Module):
    """A sensor: ``sensor(light)`` is the measurement ``(N, H, W)`` of light ``(N, H, W)``, 1.0 at full scale.

    One that rounds has a bit depth and takes a smaller number of effective bits as well, ``sensor(light, bits)``.
    """

    bit_depth: int | None = None
    """Bits of the converter; None where nothing is rounded."""
    full_well: float | None = None
    """Electrons at full scale; None without shot noise."""
    read_noise: float = 0.0
    """Standard deviation in DN."""
    pattern: str | None = None
    """Colours that a cell of 2 x 2 pixels sees; None for a gray sensor."""

    def forward(self, light: torch.Tensor, bits: int | None = None) -> torch.Tensor:
        raise NotImplementedError
