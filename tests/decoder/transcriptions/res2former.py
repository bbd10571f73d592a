"""Res2former with its modules found by their published names, and the attention of four heads written out."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv3d, leaky

HEADS = 4


def res2former(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W)."""
    height, width = y.shape[-2:]
    x = F.pad(y[:, None] + mask * y[:, None], (0, -width % 4, 0, -height % 4), mode="replicate")[:, None]
    low = leaky(conv3d(state, "conv_first.2", leaky(conv3d(state, "conv_first.0", x)), 2))
    outer = modules(state, "encoder.0.0", low)
    deep = modules(state, "bottleneck", conv3d(state, "encoder.0.1", outer, 2))
    up = shuffled(conv3d(state, "decoder.0.0.0", deep))
    x = modules(state, "decoder.0.2", conv3d(state, "decoder.0.1", torch.cat([up, outer], dim=1)))
    x = shuffled(conv3d(state, "conv_last.0", x + low))
    return [conv3d(state, "conv_last.4", x)[:, 0, :, :height, :width]]


def modules(state: State, level: str, x: Tensor) -> Tensor:
    depth = 1 + max(int(key.removeprefix(f"{level}.blocks.").split(".")[0]) for key in state if key.startswith(level))
    for name in (f"{level}.blocks.{number}" for number in range(depth)):
        groups = sum(key.startswith(f"{name}.cformer_list.") and key.endswith(".conv.weight") for key in state)
        results: list[Tensor] = []
        for number, part in enumerate(x.chunk(groups, dim=1)):
            results.append(branch(state, f"{name}.cformer_list.{number}", part + results[-1] if results else part))
        x = x + conv3d(state, f"{name}.last_conv", torch.cat(results, dim=1))
    return x


def branch(state: State, name: str, x: Tensor) -> Tensor:
    x = x + attention(state, f"{name}.tsab", conv3d(state, f"{name}.conv", x))
    return x + conv3d(state, f"{name}.ffn.2", leaky(conv3d(state, f"{name}.ffn.0", x)))


def attention(state: State, name: str, x: Tensor) -> Tensor:
    n, c, t, h, w = x.shape
    # In order: of a view, torch would multiply every pixel by a copy of the weights of its own.
    tokens = x.permute(0, 3, 4, 2, 1).reshape(-1, t, c).contiguous()
    qkv = F.linear(tokens, state[f"{name}.qkv.weight"])
    q, k, v = qkv.reshape(-1, t, 3, HEADS, c // HEADS).permute(2, 0, 3, 1, 4)
    weights = (q * (c // HEADS) ** -0.5 @ k.transpose(-1, -2)).softmax(dim=-1)
    mixed = (weights @ v).transpose(1, 2).reshape(-1, t, c)
    mixed = F.linear(mixed, state[f"{name}.proj.weight"], state[f"{name}.proj.bias"])
    return mixed.view(n, h, w, t, c).permute(0, 4, 3, 1, 2)


def shuffled(x: Tensor) -> Tensor:
    return torch.stack([F.pixel_shuffle(frame, 2) for frame in x.unbind(2)], dim=2)
