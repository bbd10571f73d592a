"""Self-attention along time: the tokens are the T slots of one pixel."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.attention import attention_along_time
from sci_lightning.decoder.kernels.switch import are_plain


class TemporalAttention(nn.Module):
    """Multi-head attention over the T features of every pixel, features ``(N, C, T, H, W)`` to the same.

    Args:
        channels: C.
        heads: number of heads, which share the width; the scale is ``(C / heads) ** -0.5`` whatever the width.
        width: channels of queries, keys and values, C if None; a multiple of ``heads``.
        bias: whether the joint query-key-value projection has one.
        frames: T, for a learned bias of every head on every distance in time; 0: no such bias, any T.
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
        bias = self.position_bias if self.frames else None
        if not are_plain():
            return attention_along_time(x, self.qkv, self.proj, self.heads, self.scale, bias)
        tokens = x.permute(0, 3, 4, 2, 1)  # (N, H, W, T, C)
        q, k, v = self.qkv(tokens).unflatten(-1, (3, self.heads, -1)).permute(4, 0, 1, 2, 5, 3, 6)
        products = self.scale * (q @ k.mT)  # (N, H, W, heads, T of queries, T of keys)
        if bias is not None:
            products = products + bias().mT
        mixed = F.softmax(products, dim=-1) @ v
        video: torch.Tensor = self.proj(mixed.transpose(3, 4).flatten(4)).permute(0, 4, 3, 1, 2)
        return video

    def position_bias(self) -> torch.Tensor:
        """Return the learned bias on distances in time, ``(heads, T of keys, T of queries)``."""
        return self.relative_position_bias_table[self.distances].permute(2, 0, 1)
