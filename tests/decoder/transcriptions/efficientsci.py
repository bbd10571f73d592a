"""EfficientSCI with the attention of four heads written out."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv3d, leaky


def efficientsci(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W), even H and W."""
    total = mask.sum(0)
    total[total == 0] = 1
    m = (y / total)[:, None]
    x = (m + mask * m)[:, None]
    for layer, stride in (("0", 1), ("2", 1), ("4", 2)):
        x = leaky(conv3d(state, f"fem.{layer}", x, stride))
    blocks = 1 + max(int(key.split(".")[1]) for key in state if key.startswith("resdnet_list."))
    for block in range(blocks):
        x = x + dense(state, f"resdnet_list.{block}", x)
    x = conv3d(state, "up_conv", x)
    x = torch.stack([F.pixel_shuffle(frame, 2) for frame in x.unbind(2)], dim=2)
    x = leaky(conv3d(state, "vrm.0", x))
    x = leaky(conv3d(state, "vrm.2", x))
    return [conv3d(state, "vrm.4", x)[:, 0]]


def dense(state: State, name: str, x: Tensor) -> Tensor:
    groups = 1 + sum(f"{name}.dense_conv.{group}.0.weight" in state for group in range(16))
    results = torch.empty_like(x[:, :0])
    for group, part in enumerate(x.chunk(groups, dim=1)):
        part = torch.cat([results, part], dim=1)
        if group:
            part = leaky(conv3d(state, f"{name}.dense_conv.{group - 1}.0", part))
        results = torch.cat([results, cformer(state, f"{name}.cformer_list.{group}", part)], dim=1)
    return conv3d(state, f"{name}.last_conv", results)


def cformer(state: State, name: str, x: Tensor) -> Tensor:
    space = conv3d(state, f"{name}.scb.2", leaky(conv3d(state, f"{name}.scb.0", x)))
    x = space + attention(state, f"{name}.tsab", x) + x
    return conv3d(state, f"{name}.ffn.2", leaky(conv3d(state, f"{name}.ffn.0", x))) + x


def attention(state: State, name: str, x: Tensor) -> Tensor:
    """Along time; queries, keys and values have half of the channels, the scale is that of all."""
    tokens = x.permute(0, 3, 4, 2, 1)
    query, key, value = (tokens @ state[f"{name}.qkv.weight"].T).chunk(3, dim=-1)
    heads = []
    for q, k, v in zip(query.chunk(4, dim=-1), key.chunk(4, dim=-1), value.chunk(4, dim=-1), strict=True):
        heads.append((q @ k.transpose(-1, -2) / (x.shape[1] / 4) ** 0.5).softmax(dim=-1) @ v)
    mixed = torch.cat(heads, dim=-1) @ state[f"{name}.proj.weight"].T + state[f"{name}.proj.bias"]
    return mixed.permute(0, 4, 3, 1, 2)
