"""The two-dimensional U-net that GAP-net and ADMM-net have in every stage."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.layout import channels_last


class DoubleConvolution(nn.Module):
    """Twice 3x3 and ReLU, ``(N, C, H, W)`` to ``(N, C', H, W)``."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.d_conv = nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(outputs, outputs, 3, padding=1),
            nn.ReLU(inplace=True),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.d_conv(x)


class UNet(nn.Module):
    """x + tanh of a U-net of three levels, frames as channels, ``(N, T, H, W)`` to the same; H, W multiples of 4.

    Max-pooling down, 2x2 transposed convolutions up; what comes up stands before the skip.

    Args:
        frames: T.
        channels: widths at full, half and quarter resolution.
    """

    def __init__(self, frames: int, channels: Sequence[int] = (32, 64, 128)) -> None:
        super().__init__()
        full, half, quarter = channels
        self.dconv_down1 = DoubleConvolution(frames, full)
        self.dconv_down2 = DoubleConvolution(full, half)
        self.dconv_down3 = DoubleConvolution(half, quarter)
        self.upsample2 = nn.Sequential(nn.ConvTranspose2d(quarter, half, 2, stride=2), nn.ReLU(inplace=True))
        self.upsample1 = nn.Sequential(nn.ConvTranspose2d(half, full, 2, stride=2), nn.ReLU(inplace=True))
        self.dconv_up2 = DoubleConvolution(2 * half, half)
        self.dconv_up1 = DoubleConvolution(2 * full, full)
        self.conv_last = nn.Conv2d(full, frames, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        skip1 = self.dconv_down1(channels_last(x))
        skip2 = self.dconv_down2(F.max_pool2d(skip1, 2))
        deep = self.dconv_down3(F.max_pool2d(skip2, 2))
        deep = self.dconv_up2(torch.cat([self.upsample2(deep), skip2], dim=1))
        deep = self.dconv_up1(torch.cat([self.upsample1(deep), skip1], dim=1))
        return x + torch.tanh(self.conv_last(deep))
