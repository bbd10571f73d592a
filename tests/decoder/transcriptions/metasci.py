"""MetaSCI without its modulation."""

from __future__ import annotations

from torch import Tensor

from tests.decoder.transcriptions.layers import State, conv2d, leaky, up2d


def metasci(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The video (N, T, H, W), even H and W."""
    total = mask.sum(0)
    total[total == 0] = 1
    m = (y / total)[:, None]
    x = m + mask * m
    for layer, stride in (("0", 1), ("2", 1), ("4", 1), ("6", 2)):
        x = leaky(conv2d(state, f"conv1.{layer}", x, stride))
    for block in range(1 + max(int(key.split(".")[1]) for key in state if key.startswith("layers."))):
        name = f"layers.{block}"
        z = x
        for layer in ("0", "2", "4"):
            z = leaky(conv2d(state, f"{name}.conv1.{layer}", z))
        x = x + conv2d(state, f"{name}.conv1.6", z)
        x = leaky(conv2d(state, f"{name}.conv2.2", leaky(conv2d(state, f"{name}.conv2.0", x))))
    x = leaky(up2d(state, "conv2.0", x))
    x = leaky(conv2d(state, "conv2.2", x))
    x = leaky(conv2d(state, "conv2.4", x))
    return [conv2d(state, "conv2.6", x)]
