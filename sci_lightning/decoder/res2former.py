"""Res2former: the decoder of the deep-optics paper, whose main operation is attention along time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.attention import TemporalAttention
from sci_lightning.decoder.layers.convolution import Conv3d, LastConv3d, pixel_shuffle
from sci_lightning.decoder.layers.kernels import as_one_channel
from sci_lightning.decoder.layers.sequential import Chain, leaky_relu_after_all, leaky_relu_between, saving_memory
from sci_lightning.errors import BadInput

PUBLISHED_LEVELS = (("encode", "encoder.0.0"), ("bottleneck", "bottleneck"), ("decode_blocks", "decoder.0.2"))
"""Names of the ResTSA modules of every level, here and in the authors' files."""


class TSABranch(nn.Module):
    """Temporal self-attention on one group of channels ``(N, c, T, H, W)``.

    The result is z + conv1x1x1(LeakyReLU(conv3x3x3(z))), where z = x + attention(conv1x3x3(x)).

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Section 4.3, Eq. 8 to 12.
    """

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.conv = Conv3d(channels, channels, (1, 3, 3))
        self.attention = TemporalAttention(channels, heads)
        self.feed_forward = leaky_relu_between(Conv3d(channels, channels, 3), Conv3d(channels, channels, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x + saving_memory(self._attended, x, self)
        return x + self.feed_forward(x)

    def _attended(self, x: torch.Tensor) -> torch.Tensor:
        attended: torch.Tensor = self.attention(self.conv(x))
        return attended


class ResTSA(nn.Module):
    """Channels in groups; the branch of a group also gets the result of the branch before (Section 4.3, Eq. 7)."""

    def __init__(self, channels: int, groups: int, heads: int) -> None:
        super().__init__()
        self.branches = nn.ModuleList(TSABranch(channels // groups, heads) for _ in range(groups))
        self.last = Conv3d(channels, channels, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        results: list[torch.Tensor] = []
        for branch, part in zip(self.branches, x.chunk(len(self.branches), dim=1), strict=True):
            results.append(branch(part + results[-1]) if results else saving_memory(branch, part, branch))
        return x + self.last(torch.cat(results, dim=1))


class Res2former(Decoder):
    """A U-shaped network of two levels of ResTSA modules, for any T, H and W (padded to multiples of 4 inside).

    The input as published is y + M * y.

    Args:
        dim: C, width at full resolution; 2C at half, 4C at a quarter (96; Res2former-L: 128).
        depths: (N1, N2), ResTSA modules at the outer level (each way) and at the bottleneck (3, 3; L: 5, 5).
        groups: branches of a ResTSA module at the outer level and at the bottleneck (2, 4; L: 4, 8).
        heads: attention heads in each branch (4).
        checkpoint: whether to train on less memory; see :class:`~sci_lightning.decoder.layers.sequential.Chain`.
        first_estimate: see :class:`Decoder`.

    Raises:
        BadInput: a width does not divide into groups and heads.

    Parameters: 11,022,625 with the defaults, 17,697,153 for Res2former-L.
    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Section 4.3.
    """

    multiple = 4
    published_names: ClassVar[tuple[tuple[str, str], ...]] = (
        (r"extract\.(.*)", r"conv_first.\1"),
        *(
            (rf"{ours}\.(\d+)\.branches\.(\d+)\.{name}\.(.*)", rf"{theirs}.blocks.\1.cformer_list.\2.{part}.\3")
            for ours, theirs in PUBLISHED_LEVELS
            for name, part in (("conv", "conv"), ("attention", "tsab"), ("feed_forward", "ffn"))
        ),
        *((rf"{ours}\.(\d+)\.last\.(.*)", rf"{theirs}.blocks.\1.last_conv.\2") for ours, theirs in PUBLISHED_LEVELS),
        (r"down\.(.*)", r"encoder.0.1.\1"),
        (r"up\.(.*)", r"decoder.0.0.0.\1"),
        (r"fuse\.(.*)", r"decoder.0.1.\1"),
        (r"expand\.(.*)", r"conv_last.0.\1"),
        (r"last\.(.*)", r"conv_last.4.\1"),
    )

    def __init__(
        self,
        dim: Width = 96,
        depths: Sequence[Depth] = (3, 3),
        groups: Sequence[Depth] = (2, 4),
        heads: Depth = 4,
        checkpoint: bool = False,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        for width, parts in ((2 * dim, groups[0]), (4 * dim, groups[1])):
            if width % (parts * heads):
                raise BadInput(
                    f"Res2former: width {width} does not divide into {parts} groups of {heads} heads; "
                    f"choose dim, groups and heads so that it does"
                )
        half, quarter = 2 * dim, 4 * dim
        # Two convolutions in every branch, one branch behind the other: at half resolution, and at a quarter.
        self.receptive_field = 2 * (4 * depths[0] * groups[0]) + 4 * (2 * depths[1] * groups[1]) + 8
        self.extract = leaky_relu_after_all(Conv3d(1, dim, 3), Conv3d(dim, half, (1, 3, 3), stride=2))
        self.encode = Chain((ResTSA(half, groups[0], heads) for _ in range(depths[0])), checkpoint)
        self.down = Conv3d(half, quarter, (1, 3, 3), stride=2)
        self.bottleneck = Chain((ResTSA(quarter, groups[1], heads) for _ in range(depths[1])), checkpoint)
        self.up = Conv3d(quarter, 2 * quarter, 1)
        self.fuse = Conv3d(2 * half, half, 1)
        self.decode_blocks = Chain((ResTSA(half, groups[0], heads) for _ in range(depths[0])), checkpoint)
        self.expand = Conv3d(half, 2 * half, 1)
        self.last = LastConv3d(dim, 1, 3)
        self.begin_at_first_video(self.last)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        first = self.first_video(measurement.unsqueeze(1) * (1 + mask), measurement, mask)
        low = self.extract(as_one_channel(first.video))
        outer = self.encode(low)
        deep = self.bottleneck(self.down(outer))
        features = self.fuse(torch.cat([pixel_shuffle(self.up(deep)), outer], dim=1))
        del deep, outer  # full resolution, which follows, needs the most memory
        features = self.decode_blocks(features) + low
        del low
        features = pixel_shuffle(self.expand(features))
        return first.plus(self.last(features)[:, 0])
