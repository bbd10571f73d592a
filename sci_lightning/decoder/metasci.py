"""MetaSCI: a two-dimensional residual network."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.convolution import LastConv2d
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.decoder.layers.sequential import leaky_relu_after_all, leaky_relu_between


class ResidualBlock(nn.Module):
    """``conv2(x + conv1(x))`` on features ``(N, C, H, W)``, without a second residual connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv1 = leaky_relu_between(
            nn.Conv2d(channels, channels, 3, padding=1),
            nn.Conv2d(channels, channels, 1),
            nn.Conv2d(channels, channels, 3, padding=1),
            nn.Conv2d(channels, channels, 3, padding=1),
        )
        self.conv2 = leaky_relu_after_all(nn.Conv2d(channels, channels, 3, padding=1), nn.Conv2d(channels, channels, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.conv2(x + self.conv1(x))


class MetaSCI(Decoder):
    """A network of residual blocks at half resolution that takes the T frames as channels.

    The input as published is m + M * m, where m = y / sum of M. T is fixed at construction; H and W are free:
    up-sampling makes odd sides one pixel too long, which is cut off.

    Args:
        frames: T.
        channels: width C at half resolution, a multiple of 8 (128 as published).
        blocks: residual blocks (3 as published).
        first_estimate: see :class:`Decoder`.

    Parameters: 2,066,968 with the defaults at T = 8.
    Source: Wang, Zhang, Liu, Chen and Yuan, "MetaSCI: scalable and adaptive reconstruction for video compressive
    sensing", CVPR 2021, in the form of the cacti toolbox: without the modulation that adapts it to a new mask.
    """

    period = 2

    def __init__(
        self, frames: Frames, channels: Width = 128, blocks: Depth = 3, first_estimate: FirstEstimate = "published"
    ) -> None:
        super().__init__(first_estimate)
        self.frames = frames
        self.receptive_field = 8 * blocks + 7
        half, quarter, eighth = channels // 2, channels // 4, channels // 8
        self.conv1 = leaky_relu_after_all(
            nn.Conv2d(frames, quarter, 5, padding=2),
            nn.Conv2d(quarter, half, 3, padding=1),
            nn.Conv2d(half, half, 1),
            nn.Conv2d(half, channels, 3, stride=2, padding=1),
        )
        self.layers = nn.Sequential(*(ResidualBlock(channels) for _ in range(blocks)))
        self.conv2 = leaky_relu_between(
            nn.ConvTranspose2d(channels, half, 3, stride=2, padding=1, output_padding=1),
            nn.Conv2d(half, quarter, 3, padding=1),
            nn.Conv2d(quarter, eighth, 1),
            LastConv2d(eighth, frames, 3, padding=1),
        )
        self.begin_at_first_video(self.conv2)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        published = self.operator(mask).mean_frame(measurement).unsqueeze(1) * (1 + mask)
        first = self.first_video(published, measurement, mask)
        features = self.conv1(channels_last(first.video))
        result = self.conv2(self.layers(features))
        # the caller cuts odd sides; only a video to be improved has to have the same sides here
        return first.plus(result[..., : mask.shape[1], : mask.shape[2]]) if first.improved else result
