"""Convolution over time, height and width, by whichever of several equal ways is fastest."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.winograd import winograd


class Conv3d(nn.Conv3d):
    """``nn.Conv3d`` that keeps T, and H and W up to the stride: same weights, same result to rounding.

    Input ``(N, C, T, H, W)``, fastest in channels-last layout (``memory_format=torch.channels_last_3d``), in which it
    also returns.

    Args:
        channels: C of the input.
        outputs: channels of the output.
        kernel: taps along time, height and width, all odd; one number for all three.
        stride: 1, or 2 to halve height and width (rounded up).
    """

    def __init__(self, channels: int, outputs: int, kernel: int | tuple[int, int, int], stride: int = 1) -> None:
        sides = (kernel, kernel, kernel) if isinstance(kernel, int) else kernel
        padding = (sides[0] // 2, sides[1] // 2, sides[2] // 2)
        super().__init__(channels, outputs, sides, (1, stride, stride), padding)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        assert self.bias is not None
        taps = self.kernel_size[0]
        x = x.contiguous(memory_format=torch.channels_last_3d)
        if self._suits_winograd(x):
            return winograd(x, self.weight, self.bias)
        if taps == 1:
            return as_video(self._of_frames(as_frames(x), self.weight.squeeze(2), self.bias), len(x))
        if taps * self.out_channels <= 16:
            return self._taps_as_outputs(x)
        # torch keeps a small convolution of a single clip from the fast library, but not one of a batch of frames;
        # and the gradient of more taps than frames has NaN in it, in bfloat16 on a CPU
        small = len(x) == 1 and x[..., 0].numel() <= 20480 and max(self.kernel_size) <= 3
        if small or x.shape[2] < taps:
            return self._taps_as_inputs(x)
        return super().forward(x)

    def _suits_winograd(self, x: torch.Tensor) -> bool:
        """On a GPU, and in mixed precision, the vendor's library chooses for itself."""
        return (
            x.device.type == "cpu"
            and x.dtype == torch.float32
            and not torch.is_autocast_enabled("cpu")
            and self.kernel_size[1:] == (3, 3)
            and self.stride == (1, 1, 1)
            and min(self.in_channels, self.out_channels) >= 32
        )

    def _taps_as_outputs(self, x: torch.Tensor) -> torch.Tensor:
        """One 2-D convolution with an output for each tap along time: up to 16 cost the same."""
        assert self.bias is not None
        taps, t = self.kernel_size[0], x.shape[2]
        parts = self._of_frames(as_frames(x), self.weight.permute(2, 0, 1, 3, 4).flatten(0, 1), None)
        parts = F.pad(as_video(parts, len(x)), (0, 0, 0, 0, taps // 2, taps // 2)).unflatten(1, (taps, -1))
        shifted = [parts[:, tap, :, tap : tap + t] for tap in range(taps)]
        return torch.stack(shifted).sum(0) + self.bias.view(-1, 1, 1, 1)

    def _taps_as_inputs(self, x: torch.Tensor) -> torch.Tensor:
        """One 2-D convolution of each frame with its neighbours as further channels."""
        taps, t = self.kernel_size[0], x.shape[2]
        padded = F.pad(x, (0, 0, 0, 0, taps // 2, taps // 2))
        neighbours = torch.cat([padded[:, :, tap : tap + t] for tap in range(taps)], dim=1)
        weight = self.weight.transpose(1, 2).flatten(1, 2)
        return as_video(self._of_frames(as_frames(neighbours), weight, self.bias), len(x))

    def _of_frames(self, x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None) -> torch.Tensor:
        return F.conv2d(x, weight, bias, self.stride[1:], self.padding[1:])


class Doubling(nn.ConvTranspose3d):
    """Transposed 1x3x3 convolution that doubles H and W, ``(N, C, T, H, W)`` to ``(N, O, T, 2H, 2W)``."""

    def __init__(self, channels: int, outputs: int) -> None:
        super().__init__(channels, outputs, (1, 3, 3), (1, 2, 2), (0, 1, 1), (0, 1, 1))

    def forward(self, x: torch.Tensor, output_size: list[int] | None = None) -> torch.Tensor:
        frames = as_frames(x.contiguous(memory_format=torch.channels_last_3d))
        return as_video(F.conv_transpose2d(frames, self.weight.squeeze(2), self.bias, 2, 1, 1), len(x))


def shuffle_up(x: torch.Tensor) -> torch.Tensor:
    """Pixel shuffle by 2 in every frame: ``(N, 4C, T, H, W)`` to ``(N, C, T, 2H, 2W)``."""
    frames = F.pixel_shuffle(as_frames(x), 2)
    return as_video(frames, len(x)).contiguous(memory_format=torch.channels_last_3d)


def one_channel(video: torch.Tensor) -> torch.Tensor:
    """``(N, T, H, W)`` as features ``(N, 1, T, H, W)``, with strides that tell torch of the channels-last layout."""
    return video.contiguous().unsqueeze(-1).permute(0, 4, 1, 2, 3)


def as_frames(x: torch.Tensor) -> torch.Tensor:
    """``(N, C, T, H, W)`` to ``(N * T, C, H, W)``, without a copy from channels-last layout."""
    return x.transpose(1, 2).flatten(0, 1)


def as_video(x: torch.Tensor, snapshots: int) -> torch.Tensor:
    """``(N * T, C, H, W)`` to ``(N, C, T, H, W)``, with N = ``snapshots``."""
    return x.unflatten(0, (snapshots, -1)).transpose(1, 2)
