"""STFormer with its tables of relative positions spelled out, and softmax(Q K^T) V."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv3d, leaky, linear, norm, up3d

WINDOW, SHIFT, HEADS = 7, 3, 4


def stformer(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W), even H and W."""
    total = mask.sum(0)
    total[total == 0] = 1
    x = mask * y[:, None]
    x = x + mask * ((y - (mask * x).sum(1)) / total)[:, None]
    x = x[:, None]
    for layer, stride in (("0", 1), ("2", 1), ("4", 1), ("6", 2), ("8", 1)):
        x = leaky(conv3d(state, f"token_gen.{layer}", x, stride))
    x = x.permute(0, 2, 3, 4, 1)
    for unit in range(1 + max(int(key.split(".")[1]) for key in state if key.startswith("layers."))):
        for number, shift in enumerate((0, SHIFT)):
            x = block(state, f"layers.{unit}.blocks.{number}", x, shift)
    x = x.permute(0, 4, 1, 2, 3)
    x = leaky(up3d(state, "conv2.0", x))
    x = leaky(conv3d(state, "conv2.2", x))
    x = leaky(conv3d(state, "conv2.4", x))
    return [conv3d(state, "conv2.6", x)[:, 0]]


def block(state: State, name: str, x: Tensor, shift: int) -> Tensor:
    n, t, h, w, c = x.shape
    rows, columns = min(h, WINDOW), min(w, WINDOW)
    z = F.pad(norm(state, f"{name}.norm1", x), (0, 0, 0, -w % columns, 0, -h % rows))
    high, wide = z.shape[2:4]
    down, right = (0 if side <= WINDOW else shift for side in (h, w))
    grid = (high // rows, wide // columns)

    rolled = torch.roll(z, (-down, -right), (2, 3))
    tokens = rolled.view(n, t, grid[0], rows, grid[1], columns, c).transpose(3, 4).reshape(-1, rows * columns, c)
    bias = torch.zeros(len(tokens) // (n * t), rows * columns, rows * columns)
    if down or right:
        part = torch.zeros(high, wide)
        for i, of_rows in enumerate(thirds(down)):
            for j, of_columns in enumerate(thirds(right)):
                part[of_rows, of_columns] = 3 * i + j
        part = part.view(grid[0], rows, grid[1], columns).transpose(1, 2).reshape(-1, rows * columns)
        bias[part[:, :, None] != part[:, None, :]] = -100
    place = torch.tensor([(i, j) for i in range(WINDOW) for j in range(WINDOW)])
    away = place[:, None] - place[None] + WINDOW - 1
    index = away[..., 0] * (2 * WINDOW - 1) + away[..., 1]
    space = attention(state, f"{name}.attn", tokens, index, c // HEADS, bias)
    space = space.view(n, t, *grid, rows, columns, c).transpose(3, 4).reshape(z.shape)
    space = torch.roll(space, (down, right), (2, 3))

    tokens = z.permute(0, 2, 3, 1, 4).reshape(-1, t, c).contiguous()  # see res2former.py
    index = torch.tensor([[i - j + t - 1 for j in range(t)] for i in range(t)])
    time = attention(state, f"{name}.time_attn", tokens, index, c // HEADS)
    time = time.view(n, high, wide, t, c).permute(0, 3, 1, 2, 4)

    x = x + (space + time)[:, :, :h, :w]
    a, b = norm(state, f"{name}.norm2", x).permute(0, 4, 1, 2, 3).chunk(2, dim=1)
    a = a + twice(state, f"{name}.ff.part1", a)
    b = b + a
    b = b + twice(state, f"{name}.ff.part2", b)
    return x + torch.cat([a, b], dim=1).permute(0, 2, 3, 4, 1)


def thirds(shift: int) -> list[slice]:
    return [slice(None)] if shift == 0 else [slice(-WINDOW), slice(-WINDOW, -shift), slice(-shift, None)]


def attention(state: State, name: str, x: Tensor, index: Tensor, full_width: int, bias: Tensor | None = None) -> Tensor:
    """full_width: of a head whose q, k and v are as wide as x; the scale is made of it."""
    batch, length, _ = x.shape
    q, k, v = linear(state, f"{name}.qkv", x).reshape(batch, length, 3, HEADS, -1).permute(2, 0, 3, 1, 4)
    scores = q * full_width**-0.5 @ k.transpose(-2, -1)
    table = state[f"{name}.relative_position_bias_table"]
    scores = scores + table[index[:length, :length]].permute(2, 0, 1)
    if bias is not None:
        scores = (scores.unflatten(0, (-1, len(bias))) + bias[:, None]).flatten(0, 1)
    return linear(state, f"{name}.proj", (scores.softmax(-1) @ v).transpose(1, 2).reshape(batch, length, -1))


def twice(state: State, name: str, x: Tensor) -> Tensor:
    return conv3d(state, f"{name}.2", leaky(conv3d(state, f"{name}.0", x)))
