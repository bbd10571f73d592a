"""Self-attention along time: the tokens are the T slots of one pixel."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F


class TemporalAttention(nn.Module):
    """Multi-head attention over the T features of each pixel, features ``(N, C, T, H, W)`` to the same.

    Args:
        channels: C of the features.
        heads: number of heads; the scale is ``(C / heads) ** -0.5``, whatever ``width`` is.
        bias: whether the joint query-key-value projection has one.
        width: of the queries, the keys and the values, a multiple of ``heads``; None: C.
    """

    def __init__(self, channels: int, heads: int = 4, bias: bool = False, width: int | None = None) -> None:
        super().__init__()
        self.heads = heads
        self.width = channels if width is None else width
        self.qkv = nn.Linear(channels, 3 * self.width, bias=bias)
        self.proj = nn.Linear(self.width, channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        n, c, t, h, w = x.shape
        tokens = x.permute(0, 3, 4, 2, 1).reshape(n * h * w, t, c)
        qkv = self.qkv(tokens).view(n * h * w, t, 3, self.heads, self.width // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4)
        mixed = F.scaled_dot_product_attention(q, k, v, scale=(c / self.heads) ** -0.5)
        return self.proj(mixed.transpose(1, 2).flatten(2)).view(n, h, w, t, c).permute(0, 4, 3, 1, 2)
