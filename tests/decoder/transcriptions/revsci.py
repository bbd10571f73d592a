"""RevSCI with whole feature maps that are split and joined in every block."""

from __future__ import annotations

import torch
from torch import Tensor

from tests.decoder.transcriptions.layers import State, conv3d, leaky, up3d


def revsci(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W), even H and W."""
    total = mask.sum(0)
    total[total == 0] = 1
    m = (y / total)[:, None]
    x = (m + mask * m)[:, None]
    for layer, stride in (("0", 1), ("2", 1), ("4", 1), ("6", 2)):
        x = leaky(conv3d(state, f"conv1.{layer}", x, stride))
    blocks = 1 + max(int(key.split(".")[1]) for key in state if key.startswith("layers."))
    for block in range(blocks):
        x1, x2 = x.chunk(2, dim=1)
        y1 = x1 + twice(state, f"layers.{block}.f1", x2)
        y2 = x2 + twice(state, f"layers.{block}.g1", y1)
        x = torch.cat([y1, y2], dim=1)
    x = leaky(up3d(state, "conv2.0", x))
    x = leaky(conv3d(state, "conv2.2", x))
    x = leaky(conv3d(state, "conv2.4", x))
    return [conv3d(state, "conv2.6", x)[:, 0]]


def twice(state: State, name: str, x: Tensor) -> Tensor:
    return conv3d(state, f"{name}.2", leaky(conv3d(state, f"{name}.0", x)))
