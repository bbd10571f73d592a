"""Convolutions of video features ``(N, C, T, H, W)``: in space and time, and the two ways to double H and W."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.convolution3d import convolution3d, transposed_convolution
from sci_lightning.decoder.kernels.layout import as_frames, as_video, channels_last
from sci_lightning.decoder.kernels.switch import are_plain
from sci_lightning.full_precision import full_precision


class Conv3d(nn.Conv3d):
    """``nn.Conv3d`` with zeros around the video, so that T stays, and H and W up to the stride.

    Args:
        channels: C, number of input channels.
        outputs: O, number of output channels; ``(N, C, T, H, W)`` becomes ``(N, O, T, H', W')``.
        kernel: number of taps along time, height and width, all odd; one number for all three.
        stride: 1, or 2 to halve height and width (rounded up).
    """

    bias: torch.Tensor

    def __init__(self, channels: int, outputs: int, kernel: int | tuple[int, int, int], stride: int = 1) -> None:
        sides = (kernel, kernel, kernel) if isinstance(kernel, int) else kernel
        padding = (sides[0] // 2, sides[1] // 2, sides[2] // 2)
        super().__init__(channels, outputs, sides, (1, stride, stride), padding)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x) if are_plain() else convolution3d(x, self.weight, self.bias, self.stride[1])


class TransposedConv3d(nn.ConvTranspose3d):
    """Transposed 1 x 3 x 3 convolution that doubles H and W: ``(N, C, T, H, W)`` to ``(N, O, T, 2H, 2W)``."""

    def __init__(self, channels: int, outputs: int) -> None:
        super().__init__(channels, outputs, (1, 3, 3), (1, 2, 2), (0, 1, 1), (0, 1, 1))

    def forward(self, x: torch.Tensor, output_size: list[int] | None = None) -> torch.Tensor:
        return super().forward(x, output_size) if are_plain() else transposed_convolution(x, self.weight, self.bias)


def pixel_shuffle(x: torch.Tensor) -> torch.Tensor:
    """Double H and W of every frame by pixel shuffle: ``(N, 4C, T, H, W)`` to ``(N, C, T, 2H, 2W)``."""
    return channels_last(as_video(F.pixel_shuffle(as_frames(x), 2), len(x)))


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
