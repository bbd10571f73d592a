"""GAP-net and ADMM-net, and the U-net of their stages."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv2d


def gap_net(state: State, y: Tensor, mask: Tensor, squared: bool) -> list[Tensor]:
    """Every stage's video (N, T, H, W), H and W multiples of 4."""
    weight = divisor(mask, squared)
    x, videos = mask * y[:, None], []
    for stage in stages(state):
        x = x + mask * ((y - (mask * x).sum(1)) / weight)[:, None]
        videos.append(x := unet(state, f"unet{stage}", x))
    return videos


def admm_net(state: State, y: Tensor, mask: Tensor, squared: bool) -> list[Tensor]:
    """Every stage's video (N, T, H, W), H and W multiples of 4."""
    weight = divisor(mask, squared)
    theta, videos = mask * y[:, None], []
    b = torch.zeros_like(theta)
    for stage in stages(state):
        v = theta + b
        x = v + mask * ((y - (mask * v).sum(1)) / (weight + state[f"gamma{stage}"]))[:, None]
        videos.append(theta := unet(state, f"unet{stage}", x - b))
        b = b - (x - theta)
    return videos


def stages(state: State) -> range:
    return range(1, 1 + sum(key.endswith("conv_last.bias") for key in state))


def divisor(mask: Tensor, squared: bool) -> Tensor:
    total = (mask**2 if squared else mask).sum(0)
    total[total == 0] = 1
    return total


def unet(state: State, name: str, x: Tensor) -> Tensor:
    full = twice(state, f"{name}.dconv_down1", x)
    half = twice(state, f"{name}.dconv_down2", F.max_pool2d(full, 2))
    quarter = twice(state, f"{name}.dconv_down3", F.max_pool2d(half, 2))
    z = twice(state, f"{name}.dconv_up2", torch.cat([up(state, f"{name}.upsample2", quarter), half], dim=1))
    z = twice(state, f"{name}.dconv_up1", torch.cat([up(state, f"{name}.upsample1", z), full], dim=1))
    return x + torch.tanh(conv2d(state, f"{name}.conv_last", z))


def twice(state: State, name: str, x: Tensor) -> Tensor:
    return F.relu(conv2d(state, f"{name}.d_conv.2", F.relu(conv2d(state, f"{name}.d_conv.0", x))))


def up(state: State, name: str, x: Tensor) -> Tensor:
    return F.relu(F.conv_transpose2d(x, state[f"{name}.0.weight"], state[f"{name}.0.bias"], 2))
