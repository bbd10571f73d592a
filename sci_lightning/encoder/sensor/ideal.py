"""Ideal sensor (oSR): no response."""

from __future__ import annotations

import torch
from torch import nn


class Ideal(nn.Module):
    """Returns the light ``(N, H, W)`` as it is: no clipping, no rounding, no noise."""

    def forward(self, light: torch.Tensor) -> torch.Tensor:
        return light
