"""The two-dimensional U-net in every stage of GAP-net and ADMM-net."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.layers.kernels import channels_last


class DoubleConvolution(nn.Module):
    """Two 3 x 3 convolutions, each with a ReLU behind it, ``(N, C, H, W)`` to ``(N, C', H, W)``."""

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
    """x + tanh of a U-net of three levels that takes the frames x, ``(N, T, H, W)``, as channels.

    H and W are multiples of 4. Max-pooling halves them, 2 x 2 transposed convolutions double them; up-sampled channels
    come before those of the skip.

    Args:
        frames: T.
        channels: widths at full, half and quarter resolution.
    """

    receptive_field = 23
    """Pixels of x, along rows and columns, that act on a pixel of the result."""

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
