"""The last convolutions of networks, whose results are frames: float32 also where the rest is in bfloat16.

A frame in bfloat16 has 8 significant bits, which costs 0.05 dB of a reconstruction of 40 dB.
"""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.decoder.layers.convolution import Conv3d
from sci_lightning.full_precision import full_precision


class LastConv2d(nn.Conv2d):
    """``nn.Conv2d`` in the precision of its weights, whatever ``torch.autocast`` says."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with full_precision():
            return super().forward(x.to(self.weight.dtype))


class LastConv3d(Conv3d):
    """``Conv3d`` of this package in the precision of its weights, whatever ``torch.autocast`` says."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with full_precision():
            return super().forward(x.to(self.weight.dtype))
