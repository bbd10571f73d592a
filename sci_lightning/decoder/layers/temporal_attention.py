"""Self-attention along time: the tokens are the T slots of one pixel."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

TOKENS_AT_ONCE = 4096  # as many as keep what one part of the pixels needs in the processor's cache


class TemporalAttention(nn.Module):
    """Multi-head attention over the T features of each pixel, features ``(N, C, T, H, W)`` to the same.

    Args:
        channels: C.
        heads: number of heads, which share the width; the scale is ``(C / heads) ** -0.5`` whatever the width.
        width: channels of queries, keys and values, C if None; a multiple of ``heads``.
        bias: whether the joint query-key-value projection has one.
        frames: T, for a learned bias of each head on every distance in time; 0: no such bias, any T.
    """

    distances: torch.Tensor

    def __init__(
        self, channels: int, heads: int = 4, width: int | None = None, bias: bool = False, frames: int = 0
    ) -> None:
        super().__init__()
        width = channels if width is None else width
        self.heads, self.scale, self.frames = heads, (channels / heads) ** -0.5, frames
        self.qkv = nn.Linear(channels, 3 * width, bias=bias)
        self.proj = nn.Linear(width, channels)
        if frames:
            self.relative_position_bias_table = nn.Parameter(torch.zeros(2 * frames - 1, heads))
            slots = torch.arange(frames)
            self.register_buffer("distances", slots - slots[:, None] + frames - 1, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        n, c, t, h, w = x.shape
        # slots first, as the features lie in memory: every product below reads them where they are
        tokens = x.permute(2, 0, 3, 4, 1).reshape(t, n * h * w, c)
        pixels = max(1, TOKENS_AT_ONCE // t) if x.device.type == "cpu" else n * h * w
        # contiguous: else each of the three projections copies, and keeps for its gradient, a part of its own
        mixed = torch.cat([self.attend(part.contiguous()) for part in tokens.split(pixels, dim=1)], dim=1)
        return mixed.view(t, n, h, w, c).permute(1, 4, 0, 2, 3)

    def attend(self, tokens: torch.Tensor) -> torch.Tensor:
        """Some of the pixels, ``(T, pixels, C)``."""
        t, pixels, _ = tokens.shape
        biases = (None, None, None) if self.qkv.bias is None else self.qkv.bias.chunk(3)
        q, k, v = (
            F.linear(tokens, weight, bias).view(t, pixels * self.heads, -1).transpose(0, 1)
            for weight, bias in zip(self.qkv.weight.chunk(3), biases, strict=True)
        )
        scores = self.scale * (k @ q.transpose(1, 2))  # (pixel and head, slot of k, slot of q)
        if self.frames:
            table = self.relative_position_bias_table[self.distances].permute(2, 0, 1)
            scores = (scores.view(-1, *table.shape) + table).view_as(scores)
        # over the first dimension: over a last one as short as T, torch's softmax takes longer than all the rest
        weights = F.softmax(scores.movedim(1, 0), dim=0).movedim(0, 2)
        return self.proj((weights @ v).transpose(0, 1).reshape(t, pixels, -1))
