"""E2E-CNN: a two-dimensional convolutional network, trained end to end."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.convolution import LastConv2d
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.decoder.layers.sequential import leaky_relu_after_all, leaky_relu_between


class ResidualBlock(nn.Module):
    """``x + conv(LeakyReLU(conv(x)))`` with 3 x 3 convolutions, on features ``(N, C, H, W)``."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = leaky_relu_between(
            nn.Conv2d(channels, channels, 3, padding=1), nn.Conv2d(channels, channels, 3, padding=1)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.layers(x)


class E2ECNN(Decoder):
    """A network at full resolution that takes the T frames as channels, with skips from its first to its last blocks.

    The input as published is M * (y / sum of M), and the output passes a tanh. T is fixed at construction; H and W are
    free.

    Args:
        frames: T.
        channels: width C of every hidden layer (64 as published).
        blocks: residual blocks on each side (5 as published).
        input_residual: whether the input is added to the output, as in the cacti toolbox.
        first_estimate: see :class:`Decoder`.

    Parameters: 817,608 with the defaults at T = 8.
    Source: Qiao et al., "Deep learning for video compressive sensing", APL Photonics 2020.
    """

    published_names: ClassVar[tuple[tuple[str, str], ...]] = (
        (r"first\.(.*)", r"conv1.\1"),
        *((rf"encode\.{i}\.layers\.0\.(.*)", rf"encode{i + 1}.conv1.\1") for i in range(5)),
        *((rf"encode\.{i}\.layers\.2\.(.*)", rf"encode{i + 1}.conv2.\1") for i in range(5)),
        *((rf"decode_blocks\.{i}\.layers\.0\.(.*)", rf"decode{5 - i}.conv1.\1") for i in range(5)),
        *((rf"decode_blocks\.{i}\.layers\.2\.(.*)", rf"decode{5 - i}.conv2.\1") for i in range(5)),
        (r"last\.(.*)", r"last_act.0.\1"),
    )

    def __init__(
        self,
        frames: Frames,
        channels: Width = 64,
        blocks: Depth = 5,
        input_residual: bool = False,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        self.frames = frames
        self.receptive_field = 4 * blocks + 3
        self.input_residual = input_residual
        self.first = nn.Conv2d(frames, channels, 3, padding=1)
        self.encode = nn.ModuleList(ResidualBlock(channels) for _ in range(blocks))
        self.latent = leaky_relu_after_all(
            nn.Conv2d(channels, channels, 3, padding=1), nn.Conv2d(channels, channels, 3, padding=1)
        )
        self.decode_blocks = nn.ModuleList(ResidualBlock(channels) for _ in range(blocks))
        self.last = LastConv2d(channels, frames, 1)
        self.begin_at_first_video(self.last)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        first = self.first_video(operator.adjoint(operator.mean_frame(measurement)), measurement, mask)
        features = self.first(channels_last(first.video))
        skips = []
        for block in self.encode:
            features = block(features)
            skips.append(features)
        features = self.latent(features)
        for block, skip in zip(self.decode_blocks, reversed(skips), strict=True):
            features = block(features + skip)
        video = torch.tanh(self.last(features))
        return video + first.video if self.input_residual else first.plus(video)
