"""ELP-Unfolding in its two phases, with the equations of one prior apart from those of an ensemble."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv2d


def elp_unfolding(state: State, y: Tensor, mask: Tensor, squared: bool) -> list[Tensor]:
    """The estimates x of all iterations, each (N, T, H, W)."""
    total = mask.sum(0)
    total[total == 0] = 1
    energy = (mask**2).sum(0) if squared else mask.sum(0)
    energy[energy == 0] = 1
    m = y / total
    iterations = sum(key.startswith("all.0.") and key.endswith("gamma1") for key in state)
    priors = 1 + max(int(key.split(".")[1]) for key in state)

    def towards(z: Tensor, gamma: Tensor) -> Tensor:
        return z + mask * ((y - (mask * z).sum(1)) / (energy + gamma))[:, None]

    v = torch.ones(len(y), *mask.shape)
    l1, l2 = torch.zeros_like(y), torch.zeros_like(v)
    sums, videos = None, []
    for k in range(iterations):
        name = f"all.0.AL.{k}"
        g1, g2 = state[f"{name}.gamma1"], state[f"{name}.gamma2"]
        if k == 0:
            x = towards(v + (l2 - mask * l1[:, None]) / g2, g2 / g1)
        v, sums = unet(state, f"{name}.visualtransformer", x - l2 / g2, g2, m, sums)
        l1 = l1 - g1 * (y - (mask * x).sum(1))
        l2 = l2 - g2 * (x - v)
        x = towards(v + (l2 - mask * l1[:, None]) / g2, g2 / g1)
        videos.append(x)
    vs, l2s, g2s = [v], [l2], [g2]
    for p in range(1, priors):
        name = f"all.{p}.AL.0"
        g2 = state[f"{name}.gamma2"]
        v, sums = unet(state, f"{name}.visualtransformer", x - l2s[-1] / g2, g2, m, sums)
        l1 = l1 - g1 * (y - (mask * x).sum(1))
        l2 = l2s[-1] - g2 * (x - v)
        g = g2 + sum(g2s[q] for q in range(p - 1))
        z = -mask * l1[:, None] + l2 + g2 * v
        for q in range(p - 1):
            z = z + l2s[q] + g2s[q] * vs[q]
        x = towards(z / g, g / g1)
        videos.append(x)
        vs.append(v)
        l2s.append(l2)
        g2s.append(g2)
    return videos


def unet(
    state: State, name: str, video: Tensor, gamma: Tensor, m: Tensor, sums: list[Tensor] | None
) -> tuple[Tensor, list[Tensor]]:
    def with_sum(x: Tensor, number: int) -> Tensor:
        return x if sums is None else torch.cat([x, sums[number]], dim=1)

    def twice(block: str, x: Tensor) -> Tensor:
        return conv2d(state, f"{block}.convblock.2", conv2d(state, f"{block}.convblock.0", x).relu()).relu()

    constant = gamma * torch.ones_like(m)[:, None]
    x1 = twice(f"{name}.inc", torch.cat([video, constant, m[:, None]], dim=1))
    x2 = conv2d(state, f"{name}.downc0.convblock.0", with_sum(x1, 0), stride=2).relu()
    x2 = twice(f"{name}.downc0.convblock.2", x2)
    x3 = conv2d(state, f"{name}.downc1.convblock.0", with_sum(x2, 1), stride=2).relu()
    x3 = twice(f"{name}.downc1.convblock.2", x3)
    x4 = twice(f"{name}.upc2.convblock.0", with_sum(x3, 2))
    x4 = F.pixel_shuffle(conv2d(state, f"{name}.upc2.convblock.1", x4), 2)
    x5 = twice(f"{name}.upc1.convblock.0", with_sum(x4 + x2, 3))
    x5 = F.pixel_shuffle(conv2d(state, f"{name}.upc1.convblock.1", x5), 2)
    x6 = conv2d(state, f"{name}.outc.convblock.0", with_sum(x5 + x1, 4)).relu()
    x6 = conv2d(state, f"{name}.outc.convblock.2", x6)
    features = [x1, x2, x3, x4, x5]
    if sums is not None:
        features = [new + old for new, old in zip(features, sums, strict=True)]
    return x6 + video, features
