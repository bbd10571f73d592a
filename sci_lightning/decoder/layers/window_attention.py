"""Self-attention in windows: the tokens are the pixels of one window of a frame."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.attention import attention_in_windows, frame_by_frame
from sci_lightning.decoder.kernels.switch import are_plain

OUT_OF_REACH = -100.0
"""Added to the product of query and key of two pixels that a shifted window has brought together from opposite sides,
as published."""


class WindowAttention(nn.Module):
    """Multi-head attention between the pixels of every window, on features ``(N, T, H, W, C)``.

    H and W are multiples of the window's side, or less than it: then the window has the length of the side, and is not
    shifted.

    Args:
        channels: C, a multiple of ``heads``; queries, keys and values are all of width C.
        heads: number of heads; the scale is ``(C / heads) ** -0.5``.
        window: side of a window in pixels.
        shift: number of pixels by which the windows are shifted down and right, cyclically.

    Source: Liu et al., "Swin transformer: hierarchical vision transformer using shifted windows", ICCV 2021.
    """

    distances: torch.Tensor

    def __init__(self, channels: int, heads: int = 4, window: int = 7, shift: int = 0) -> None:
        super().__init__()
        self.heads, self.window, self.shift = heads, window, shift
        self.relative_position_bias_table = nn.Parameter(torch.empty((2 * window - 1) ** 2, heads))
        nn.init.trunc_normal_(self.relative_position_bias_table, std=0.02)
        self.qkv = nn.Linear(channels, 3 * channels)
        self.proj = nn.Linear(channels, channels)
        rows, columns = torch.arange(window**2) // window, torch.arange(window**2) % window
        down, right = (places[:, None] - places + window - 1 for places in (rows, columns))
        self.register_buffer("distances", down * (2 * window - 1) + right, persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        height, width = x.shape[2:4]
        sides = window_side(height, self.window), window_side(width, self.window)
        shifts = [self.shift if side > self.window else 0 for side in (height, width)]
        bias = self.bias(height, width, sides, shifts)

        def attend(frames: torch.Tensor) -> torch.Tensor:
            rolled = frames.roll([-shift for shift in shifts], (-3, -2))
            return self.attend(rolled, sides, bias).roll(shifts, (-3, -2))

        frames = x.flatten(0, 1)
        return (attend(frames) if are_plain() else frame_by_frame(attend, frames)).view_as(x)

    def attend(self, frames: torch.Tensor, sides: tuple[int, int], bias: torch.Tensor) -> torch.Tensor:
        """Return the attention inside the windows of one frame ``(H, W, C)`` or of several, ``(F, H, W, C)``.

        Args:
            frames: features.
            sides: height and width of a window.
            bias: added to the products of queries and keys, ``(windows or 1, heads, pixels, pixels)``.
        """
        tokens = windows(frames, sides)
        q, k, v = self.qkv(tokens).unflatten(-1, (3, self.heads, -1)).movedim(-3, 0).transpose(-3, -2)
        if are_plain():
            heads = F.softmax(q @ k.mT * q.shape[-1] ** -0.5 + bias, dim=-1) @ v
        else:
            heads = attention_in_windows(q, k, v, bias)
        mixed = self.proj(heads.transpose(-3, -2).flatten(-2))
        grid = frames.shape[-3] // sides[0], frames.shape[-2] // sides[1]
        return mixed.view(*frames.shape[:-3], *grid, *sides, -1).transpose(-4, -3).reshape(frames.shape)

    def bias(self, height: int, width: int, sides: tuple[int, int], shifts: list[int]) -> torch.Tensor:
        """Return what is added to the products of queries and keys, ``(windows or 1, heads, pixels, pixels)``."""
        pixels = sides[0] * sides[1]
        # A smaller window takes the first rows of the table of the whole window, as published.
        bias = self.relative_position_bias_table[self.distances[:pixels, :pixels]].permute(2, 0, 1)
        if not any(shifts):
            return bias.unsqueeze(0)
        parts = [self.origin(side, shift) for side, shift in zip((height, width), shifts, strict=True)]
        part = windows((3 * parts[0][:, None] + parts[1]).unsqueeze(-1), sides).squeeze(-1)
        return bias + OUT_OF_REACH * (part.unsqueeze(1) != part.unsqueeze(2)).unsqueeze(1)

    def origin(self, side: int, shift: int) -> torch.Tensor:
        """Return the part of a rolled side that a pixel is in: 0 before the last window, 1 in it, 2 if wrapped."""
        places = torch.arange(side, device=self.distances.device)
        return (places >= side - self.window).long() + (places >= side - shift) if shift else torch.zeros_like(places)


def window_side(side: int, window: int) -> int:
    """Return the side of the windows of a frame: ``window``, or all of a frame that is smaller.

    It is written as a comparison because ``torch.export`` decides that once for all sizes of a graph, but carries a
    minimum through every later size.
    """
    return window if side >= window else side


def whole_windows(side: int, window: int) -> int:
    """Return the side of a frame that is padded to whole windows of :func:`window_side`."""
    window = window_side(side, window)
    return (side + window - 1) // window * window


def windows(frames: torch.Tensor, sides: tuple[int, int]) -> torch.Tensor:
    """Cut ``(.., H, W, C)`` into windows, ``(.., windows, pixels of a window, C)``."""
    rows, columns = sides
    cut = frames.unflatten(-2, (-1, columns)).unflatten(-4, (-1, rows)).transpose(-4, -3)
    return cut.flatten(-5, -4).flatten(-3, -2)
