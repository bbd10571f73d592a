"""STFormer: attention in space beside attention along time."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.attention import TemporalAttention, WindowAttention, whole_windows
from sci_lightning.decoder.layers.convolution import Conv3d, LastConv3d, TransposedConv3d
from sci_lightning.decoder.layers.kernels import as_one_channel
from sci_lightning.decoder.layers.sequential import Chain, leaky_relu_after_all, leaky_relu_between, named_block

WINDOW = 7


class FusionNetwork(nn.Module):
    """Feed-forward network on features ``(N, C, T, H, W)``, whose channels are split into halves a and b.

    The result has the halves a + f(a) and z + g(z), where z = b + a + f(a).
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        self.part1, self.part2 = (leaky_relu_between(Conv3d(half, half, 3), Conv3d(half, half, 3)) for _ in range(2))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        a, b = x.chunk(2, dim=1)
        a = a + self.part1(a)
        b = b + a
        return torch.cat([a, b + self.part2(b)], dim=1)


class STFormerBlock(nn.Module):
    """Attention in space beside attention along time, then a feed-forward network, on features ``(N, T, H, W, C)``.

    The result is s + fusion(norm(s)), where s = x + space(z) + time(z) and z = norm(x). At the bottom and right, z is
    padded with zeros to whole windows, and the zeros take part in the attention, as published.
    """

    def __init__(self, channels: int, frames: int, shift: int) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(channels)
        self.attn = WindowAttention(channels, window=WINDOW, shift=shift)
        self.norm2 = nn.LayerNorm(channels)
        self.ff = FusionNetwork(channels)
        self.time_attn = TemporalAttention(channels, width=channels // 2, bias=True, frames=frames)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        height, width = x.shape[2:4]
        below, right = (whole_windows(side, WINDOW) - side for side in (height, width))
        z = F.pad(self.norm1(x), (0, 0, 0, right, 0, below))
        mixed = self.attn(z) + self.time_attn(z.permute(0, 4, 1, 2, 3)).permute(0, 2, 3, 4, 1)
        x = x + mixed[:, :, :height, :width]
        return x + self.ff(self.norm2(x).permute(0, 4, 1, 2, 3)).permute(0, 2, 3, 4, 1)


class STFormer(Decoder):
    """Pairs of attention blocks at half resolution; the second block of every pair has shifted windows.

    The input as published is A^T y after one data step with the sum of M as weight. T is fixed at construction; H and W
    are free (padded to multiples of 2 inside).

    Args:
        frames: T.
        dim: C, width at full resolution after the first layer; 4C, of 4 heads, in the blocks (64; small: 16).
        units: pairs of blocks (4; large: 8).
        checkpoint: whether to train on less memory; see :class:`~sci_lightning.decoder.layers.sequential.Chain`.
        first_estimate: see :class:`Decoder`.

    Parameters: 19,490,177 with the defaults at T = 8.
    Source: Wang, Cao, Zhong and Yuan, "Spatial-temporal transformer for video snapshot compressive imaging", TPAMI
        2022.
    """

    multiple = 2
    period = 2 * WINDOW
    published_unused: ClassVar[tuple[str, ...]] = (
        r".*\.relative_position_index",  # computed here
        r"layers\.\d+\.blocks\.\d+\.conv_cat\.(weight|bias)",  # in the cacti toolbox, where nothing uses it
    )

    def __init__(
        self,
        frames: Frames,
        dim: Width = 64,
        units: Depth = 4,
        checkpoint: bool = False,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        self.frames = frames
        self.receptive_field = 4 * WINDOW * units + 19  # windows and shifted windows, of pixels at half resolution
        self.token_gen = leaky_relu_after_all(
            Conv3d(1, dim, 5),
            Conv3d(dim, 2 * dim, 1),
            Conv3d(2 * dim, 2 * dim, 3),
            Conv3d(2 * dim, 4 * dim, 3, stride=2),
            Conv3d(4 * dim, 4 * dim, 1),
        )
        self.conv2 = leaky_relu_between(
            TransposedConv3d(4 * dim, 2 * dim),
            Conv3d(2 * dim, 2 * dim, 3),
            Conv3d(2 * dim, dim, 1),
            LastConv3d(dim, 1, 3),
        )
        self.layers = Chain(
            (
                named_block("blocks", *(STFormerBlock(4 * dim, frames, shift) for shift in (0, WINDOW // 2)))
                for _ in range(units)
            ),
            checkpoint,
        )
        self.begin_at_first_video(self.conv2)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        published = operator.data_step(operator.adjoint(measurement), measurement, operator.total_or_one())
        first = self.first_video(published, measurement, mask)
        tokens = self.layers(self.token_gen(as_one_channel(first.video)).permute(0, 2, 3, 4, 1))
        return first.plus(self.conv2(tokens.permute(0, 4, 1, 2, 3))[:, 0])
