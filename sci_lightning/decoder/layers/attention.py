"""Self-attention along time and in windows of a frame, as the papers have it and in faster ways, equal to rounding.

Attention is computed in blocks that fit the processor's cache, with the softmax in the order that is fastest in memory.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.layers.kernels import is_reduced

ATTENTION_TOKENS = 4096
"""Tokens (slots times pixels) of attention along time whose queries, keys, values and weights are computed together."""

ATTENTION_VALUES = 2**20
"""Values of those tokens in bfloat16, of which half as many bytes have to fit."""

OUT_OF_REACH = -100.0
"""Added to the product of query and key of two pixels that a shifted window has brought together from opposite sides,
as published."""


class TemporalAttention(nn.Module):
    """Multi-head attention over the T features of every pixel, features ``(N, C, T, H, W)`` to the same.

    Args:
        channels: C.
        heads: number of heads, which share the width; the scale is ``(C / heads) ** -0.5`` whatever the width.
        width: channels of queries, keys and values, C if None; a multiple of ``heads``.
        bias: whether the joint query-key-value projection has one.
        frames: T, for a learned bias of every head on every distance in time; 0: no such bias, any T.
    """

    plain_formulas = False
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
        if not self.plain_formulas:
            return self._in_blocks(x)
        tokens = x.permute(0, 3, 4, 2, 1)  # (N, H, W, T, C)
        q, k, v = self.qkv(tokens).unflatten(-1, (3, self.heads, -1)).permute(4, 0, 1, 2, 5, 3, 6)
        products = self.scale * (q @ k.mT)  # (N, H, W, heads, T of queries, T of keys)
        if self.frames:
            products = products + self.position_bias().mT
        mixed = F.softmax(products, dim=-1) @ v
        video: torch.Tensor = self.proj(mixed.transpose(3, 4).flatten(4)).permute(0, 4, 3, 1, 2)
        return video

    def position_bias(self) -> torch.Tensor:
        """Return the learned bias on distances in time, ``(heads, T of keys, T of queries)``."""
        return self.relative_position_bias_table[self.distances].permute(2, 0, 1)

    def _in_blocks(self, x: torch.Tensor) -> torch.Tensor:
        """Return the attention, computed in blocks of pixels; fastest for x in channels-last layout."""
        n, c, t, h, w = x.shape
        # Slots first, as the features lie in memory: every product below reads them where they are.
        tokens = x.permute(2, 0, 3, 4, 1).reshape(t, n * h * w, c)
        values = ATTENTION_VALUES // c if is_reduced(x) else ATTENTION_TOKENS
        # On meta as well, where the memory is counted that a processor would need.
        pixels = max(1, values // t) if x.device.type in ("cpu", "meta") else n * h * w
        # Contiguous parts: otherwise each of the three projections copies a part, and keeps the copy for its gradient.
        parts = [self._of_pixels(part.contiguous(), is_reduced(x)) for part in tokens.split(pixels, dim=1)]
        return torch.cat(parts, dim=1).view(t, n, h, w, c).permute(1, 4, 0, 2, 3)

    def _of_pixels(self, tokens: torch.Tensor, reduced: bool) -> torch.Tensor:
        """Return the attention among the slots of some of the pixels, ``(T, pixels, C)``."""
        (t, pixels, _), heads = tokens.shape, self.heads
        if reduced:  # one wide product, of which copies are cheaper than of three narrow ones
            joint = self.qkv(tokens).view(t, pixels, 3, heads, -1)
            q, k, v = joint.permute(2, 1, 3, 0, 4).reshape(3, pixels * heads, t, -1)
        else:
            biases = (None, None, None) if self.qkv.bias is None else self.qkv.bias.chunk(3)
            q, k, v = (
                F.linear(tokens, weight, part).view(t, pixels * heads, -1).transpose(0, 1)
                for weight, part in zip(self.qkv.weight.chunk(3), biases, strict=True)
            )
        products = self.scale * (k @ q.transpose(1, 2))  # (pixel and head, slot of the key, slot of the query)
        if self.frames:
            products = (products.view(-1, heads, t, t) + self.position_bias()).view_as(products)
        # Over the first dimension: over a last one as short as T, torch's softmax takes longer than all the rest.
        weights = F.softmax(products.movedim(1, 0), dim=0).movedim(0, 2)
        mixed: torch.Tensor = self.proj((weights @ v).transpose(0, 1).reshape(t, pixels, -1))
        return mixed


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

    plain_formulas = False
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
        if self.plain_formulas:
            return attend(frames).view_as(x)
        return torch.stack([attend(frame) for frame in frames]).view_as(x)  # what one frame needs fits the cache

    def attend(self, frames: torch.Tensor, sides: tuple[int, int], bias: torch.Tensor) -> torch.Tensor:
        """Return the attention inside the windows of one frame ``(H, W, C)`` or of several, ``(F, H, W, C)``.

        Args:
            frames: features.
            sides: height and width of a window.
            bias: added to the products of queries and keys, ``(windows or 1, heads, pixels, pixels)``.
        """
        tokens = windows(frames, sides)
        q, k, v = self.qkv(tokens).unflatten(-1, (3, self.heads, -1)).movedim(-3, 0).transpose(-3, -2)
        if self.plain_formulas:
            heads = F.softmax(q @ k.mT * q.shape[-1] ** -0.5 + bias, dim=-1) @ v
        elif not is_reduced(q) or q.device.type != "cpu":
            heads = F.scaled_dot_product_attention(q, k, v, attn_mask=bias)
        else:
            # For windows of 49 pixels torch's fused attention takes twice as long as these steps, and its softmax in
            # bfloat16 three times as long as that in float32, which is more exact as well.
            products = (q * q.shape[-1] ** -0.5) @ k.mT + bias.to(q.dtype)
            heads = F.softmax(products.float(), dim=-1).to(v.dtype) @ v
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
