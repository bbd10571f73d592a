"""FastDVDnet: a network that denoises every frame with the help of its neighbours in time."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.denoiser.denoiser import Denoiser, FixedNorm, keep_scale

WINDOW = 3
"""Number of frames that each of the two passes takes; together they reach over five."""


class FastDVDnet(Denoiser):
    """Two passes of a U-net over three neighbouring frames, with a map of the strength beside every frame.

    Before the first frame comes the last, and the reverse. H and W are padded to multiples of 4 inside.

    Args:
        channels: widths at full, half and quarter resolution (32, 64, 128 as published).
        inner: channels of every frame by itself after the first convolution (30 as published).

    Parameters: 2,474,704 with the defaults.
    Source: Tassano, Delon and Veit, "FastDVDnet: towards real-time deep video denoising without flow estimation", CVPR
    2020, in grayscale and with the circular window that PnP-SCI uses.
    """

    alignment = 4
    receptive_field = 80  # 40 in each of the two passes
    published_names = (
        (r"(temp\d\.\w+)\.(\d)\.(\d\..*)", r"\1.convblock.\2.convblock.\3"),
        (r"(temp\d\.\w+)\.(\d\.[a-z].*)", r"\1.convblock.\2"),
    )

    def __init__(self, channels: Sequence[Width] = (32, 64, 128), inner: Depth = 30) -> None:
        super().__init__()
        self.temp1 = ThreeFrames(channels, inner)
        self.temp2 = ThreeFrames(channels, inner)

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        height, width = video.shape[-2:]
        video = F.pad(video, (0, -width % 4, 0, -height % 4), mode="replicate")
        return self.temp2(self.temp1(video, strength), strength)[..., :height, :width]


class ThreeFrames(nn.Module):
    """One pass: a U-net estimates the noise of every frame of ``(N, T, H, W)`` from three frames."""

    def __init__(self, channels: Sequence[int], inner: int) -> None:
        super().__init__()
        full, half, quarter = channels
        self.inc = nn.Sequential(
            *_convolution(2 * WINDOW, inner * WINDOW, groups=WINDOW), *_convolution(inner * WINDOW, full)
        )
        self.downc0 = nn.Sequential(*_convolution(full, half, stride=2), _pair(half))
        self.downc1 = nn.Sequential(*_convolution(half, quarter, stride=2), _pair(quarter))
        self.upc2 = nn.Sequential(_pair(quarter), _conv(quarter, 4 * half), nn.PixelShuffle(2))
        self.upc1 = nn.Sequential(_pair(half), _conv(half, 4 * full), nn.PixelShuffle(2))
        last = _conv(full, 1)
        self.outc = nn.Sequential(*_convolution(full, full), last)
        keep_scale(self, last)

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        level = torch.full_like(video, strength)
        window = torch.stack([video.roll(1, 1), level, video, level, video.roll(-1, 1), level], 2)
        full = self.inc(window.flatten(0, 1))
        half = self.downc0(full)
        half = half + self.upc2(self.downc1(half))
        noise = self.outc(full + self.upc1(half))
        return video - noise.view_as(video)


def _conv(inputs: int, outputs: int, stride: int = 1, groups: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, stride, padding=1, groups=groups, bias=False)


def _convolution(inputs: int, outputs: int, stride: int = 1, groups: int = 1) -> tuple[nn.Module, ...]:
    return _conv(inputs, outputs, stride, groups), FixedNorm(outputs), nn.ReLU()


def _pair(channels: int) -> nn.Sequential:
    return nn.Sequential(*_convolution(channels, channels), *_convolution(channels, channels))
