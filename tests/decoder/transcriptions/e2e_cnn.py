"""E2E-CNN with its residual blocks found by their published names."""

from __future__ import annotations

import torch
from torch import Tensor

from tests.decoder.transcriptions.layers import State, conv2d, leaky

LEVELS = range(1, 6)


def e2e_cnn(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W)."""
    total = mask.sum(0)
    total[total == 0] = 1
    x = conv2d(state, "conv1", mask * (y / total)[:, None])
    skips = []
    for level in LEVELS:
        skips.append(x := block(state, f"encode{level}", x))
    x = leaky(conv2d(state, "latent.2", leaky(conv2d(state, "latent.0", x))))
    for level in reversed(LEVELS):
        x = block(state, f"decode{level}", x + skips[level - 1])
    return [torch.tanh(conv2d(state, "last_act.0", x))]


def block(state: State, name: str, x: Tensor) -> Tensor:
    return x + conv2d(state, f"{name}.conv2", leaky(conv2d(state, f"{name}.conv1", x)))
