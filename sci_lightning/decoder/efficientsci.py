"""EfficientSCI: densely connected blocks of convolution in space and attention along time."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.attention import TemporalAttention
from sci_lightning.decoder.layers.convolution import Conv3d, LastConv3d, pixel_shuffle
from sci_lightning.decoder.layers.kernels import as_one_channel
from sci_lightning.decoder.layers.sequential import leaky_relu_after_all, leaky_relu_between
from sci_lightning.errors import BadInput


class CFormer(nn.Module):
    """Convolution in space beside attention along time, on one group of channels ``(N, c, T, H, W)``.

    The result is z + conv1x1x1(LeakyReLU(conv3x3x3(z))), where
    z = x + conv1x3x3(LeakyReLU(conv1x3x3(x))) + attention(x).
    """

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.scb = leaky_relu_between(Conv3d(channels, channels, (1, 3, 3)), Conv3d(channels, channels, (1, 3, 3)))
        self.tsab = TemporalAttention(channels, heads, width=channels // 2)
        self.ffn = leaky_relu_between(Conv3d(channels, channels, 3), Conv3d(channels, channels, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x + self.scb(x) + self.tsab(x)
        return x + self.ffn(x)


class ResDNet(nn.Module):
    """Channels in groups: a CFormer gets its group and, by a 1x1x1 convolution, the results of all groups before."""

    def __init__(self, channels: int, groups: int, heads: int) -> None:
        super().__init__()
        part = channels // groups
        self.cformer_list = nn.ModuleList(CFormer(part, heads) for _ in range(groups))
        self.dense_conv = nn.ModuleList(
            leaky_relu_after_all(Conv3d(part * parts, part, 1)) for parts in range(2, groups + 1)
        )
        self.last_conv = Conv3d(channels, channels, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        first, *others = x.chunk(len(self.cformer_list), dim=1)
        results = [self.cformer_list[0](first)]
        for cformer, dense, part in zip(self.cformer_list[1:], self.dense_conv, others, strict=True):
            results.append(cformer(dense(torch.cat([*results, part], dim=1))))
        return x + self.last_conv(torch.cat(results, dim=1))


class EfficientSCI(Decoder):
    """A sequence of ResDNet blocks at half resolution, for any T, H and W (padded to multiples of 2 inside).

    The input as published is m + M * m, where m = y / sum of M.

    Args:
        channels: C, width at full resolution; the blocks have 4C channels (64, the base model as published).
        blocks: ResDNet blocks (8).
        groups: CFormers of a block, on 4C / ``groups`` channels each (4).
        heads: attention heads of a CFormer, on half of its channels (4).
        first_estimate: see :class:`Decoder`.

    Raises:
        BadInput: the width does not divide into groups and heads.

    Parameters: 8,824,321 with the defaults.
    Source: Wang, Cao and Yuan, "EfficientSCI: densely connected network with space-time factorization for large-scale
    video snapshot compressive imaging", CVPR 2023.
    """

    multiple = 2

    def __init__(
        self,
        channels: Width = 64,
        blocks: Depth = 8,
        groups: Depth = 4,
        heads: Depth = 4,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        width = 4 * channels
        if width % (groups * 2 * heads):
            raise BadInput(
                f"EfficientSCI: half of width {width} does not divide into {groups} groups of {heads} heads; "
                f"choose channels, groups and heads so that it does"
            )
        self.receptive_field = 6 * blocks * groups + 8  # three convolutions in every CFormer, at half resolution
        self.fem = leaky_relu_after_all(
            Conv3d(1, channels, (3, 7, 7)), Conv3d(channels, 2 * channels, 3), Conv3d(2 * channels, width, 3, stride=2)
        )
        self.up_conv = Conv3d(width, 2 * width, 1)
        self.vrm = leaky_relu_between(
            Conv3d(2 * channels, 2 * channels, 3), Conv3d(2 * channels, channels, 1), LastConv3d(channels, 1, 3)
        )
        self.resdnet_list = nn.Sequential(*(ResDNet(width, groups, heads) for _ in range(blocks)))
        self.begin_at_first_video(self.vrm)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        published = self.operator(mask).mean_frame(measurement).unsqueeze(1) * (1 + mask)
        first = self.first_video(published, measurement, mask)
        features = self.resdnet_list(self.fem(as_one_channel(first.video)))
        return first.plus(self.vrm(pixel_shuffle(self.up_conv(features)))[:, 0])
