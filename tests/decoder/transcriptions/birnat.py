"""BIRNAT with all weights of the attention at once and every sum over slots written out."""

from __future__ import annotations

import torch
from torch import Tensor

from tests.decoder.transcriptions.layers import State, conv2d, leaky, up2d


def birnat(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The videos of the forward and of the backward recurrence, each (N, T, H, W)."""
    total = mask.sum(0)
    total[total == 0] = 1
    m = y / total
    slots = range(len(mask))
    frame = first_frame(state, torch.stack([m, *(mask[t] * m for t in slots)], dim=1))
    hidden = torch.zeros(len(y), state["forward_rnn.h_h.3.bias"].numel(), *y.shape[1:])
    forward, hidden = recurrence(state, "forward_rnn", frame, hidden, y, m, mask, list(slots))
    last = forward[len(mask) - 1]
    backward, _ = recurrence(state, "backrnn", last, hidden, y, m, mask, list(reversed(slots)))
    return [torch.cat([video[t] for t in slots], dim=1) for video in (forward, backward)]


def residual_part(state: State, name: str, x: Tensor) -> Tensor:
    for step in "123":
        z = leaky(conv2d(state, f"{name}.conv{step}.0", x))
        z = leaky(conv2d(state, f"{name}.conv{step}.2", z))
        x = x + conv2d(state, f"{name}.conv{step}.4", z)
    return x


def first_frame(state: State, x: Tensor) -> Tensor:
    net = "first_frame_net"
    for name, stride in (("conv1", 1), ("conv2", 1), ("conv3", 1), ("conv4", 2)):
        x = leaky(conv2d(state, f"{net}.{name}", x, stride))
    x = residual_part(state, f"{net}.res_part1", x)
    x = conv2d(state, f"{net}.conv8", leaky(conv2d(state, f"{net}.conv7", x)))
    x = residual_part(state, f"{net}.res_part2", x)
    x = conv2d(state, f"{net}.conv10", leaky(conv2d(state, f"{net}.conv9", x)))
    x = residual_part(state, f"{net}.res_part3", x)
    f, g, h = (conv2d(state, f"{net}.att1.conv{k}", x).flatten(2) for k in (1, 2, 3))
    weights = torch.einsum("nci,ncj->nij", f, g).softmax(2)
    mixed = torch.einsum("nci,nij->ncj", h, weights).reshape(x.shape)
    x = state[f"{net}.att1.gamma1"] * conv2d(state, f"{net}.att1.conv4", mixed) + x
    x = leaky(up2d(state, f"{net}.conv5", x))
    for name in ("conv51", "conv52"):
        x = leaky(conv2d(state, f"{net}.{name}", x))
    return conv2d(state, f"{net}.conv6", x)


def recurrence(
    state: State, net: str, frame: Tensor, hidden: Tensor, y: Tensor, m: Tensor, mask: Tensor, order: list[int]
) -> tuple[dict[int, Tensor], Tensor]:
    known = {order[0]: frame}
    for place in range(1, len(order)):
        explained = sum(mask[t] * known[t][:, 0] for t in order[:place])
        expected = sum((mask[t] * m for t in order[place + 1 :]), torch.zeros_like(y))
        x = torch.stack([m, y - explained - expected], dim=1)
        x = leaky(conv2d(state, f"{net}.conv_x.1", conv2d(state, f"{net}.conv_x.0", x)))
        x = leaky(conv2d(state, f"{net}.conv_x.4", conv2d(state, f"{net}.conv_x.3", x, stride=2)))
        x = up2d(state, f"{net}.conv_x.8", leaky(conv2d(state, f"{net}.conv_x.6", x)))
        z = pairs(state, f"{net}.extract_feature1.conv", known[order[place - 1]], (0, 1), (3, 4), (6,))
        features = torch.cat([hidden, x, z], dim=1)
        features = residual_part(state, f"{net}.res_part1", features)
        features = residual_part(state, f"{net}.res_part2", features)
        hidden = pairs(state, f"{net}.h_h", features, (0, 1), (3,))
        known[order[place]] = pairs(state, f"{net}.up_feature1.conv", features, (0, 1), (3, 4), (6, 7))
    return known, hidden


def pairs(state: State, name: str, x: Tensor, *groups: tuple[int, ...]) -> Tensor:
    """Convolutions in groups, LeakyReLU between the groups."""
    for number, group in enumerate(groups):
        x = leaky(x) if number else x
        for layer in group:
            x = conv2d(state, f"{name}.{layer}", x)
    return x
