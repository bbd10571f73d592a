"""SCI3D with unfolded neighbourhoods, frame by frame."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tests.decoder.transcriptions.layers import State, conv3d


def sci3d(state: State, y: Tensor, mask: Tensor) -> list[Tensor]:
    """The videos of all phases, each (N, T, H, W)."""
    energy = (mask * mask).sum(0)
    v, r, old, videos = mask * y[:, None], torch.zeros_like(y), None, []
    phases = 1 + max(int(key.split(".")[1]) for key in state if key.startswith("fcs."))
    for phase in range(phases):
        name = f"fcs.{phase}"
        r = r + (y - (mask * v).sum(1))
        v = v + mask * ((r - (mask * v).sum(1)) / (energy + state[f"{name}.eta_step"]))[:, None]
        energy[energy == 0] = 1  # as published: only now
        change, old = unet(state, name, v, y / energy, old)
        v = v + change
        videos.append(v)
    return videos


def unet(state: State, name: str, v: Tensor, guide: Tensor, old: list[Tensor] | None) -> tuple[Tensor, list[Tensor]]:
    x = torch.stack([v, guide[:, None].expand_as(v)], dim=1)
    x = conv3d(state, f"{name}.inc.convblock.0", x, groups=2).relu()
    full = conv3d(state, f"{name}.inc.convblock.2", x).relu()
    half = down(state, f"{name}.downc0.convblock", full)
    quarter = down(state, f"{name}.downc1.convblock", half)
    handed_on = [quarter]
    x = quarter
    for level, (skip, block) in enumerate(((half, "upc2"), (full, "upc1"))):
        if old is not None:
            x = torch.cat([x, gate(state, name, level, guide, old[level])], dim=1)
        x = residual_pair(state, f"{name}.{block}.convblock.0", x)
        x = F.interpolate(conv3d(state, f"{name}.{block}.convblock.1", x), scale_factor=(1, 2, 2))
        handed_on.append(x)
        x = skip + x
    if old is not None:
        x = torch.cat([x, gate(state, name, 2, guide, old[2])], dim=1)
    x = conv3d(state, f"{name}.outc.convblock.0", x).relu()
    return conv3d(state, f"{name}.outc.convblock.2", x)[:, 0], handed_on


def down(state: State, name: str, x: Tensor) -> Tensor:
    return residual_pair(state, f"{name}.2", conv3d(state, f"{name}.0", x, stride=2).relu())


def residual_pair(state: State, name: str, x: Tensor) -> Tensor:
    return conv3d(state, f"{name}.convblock.2", conv3d(state, f"{name}.convblock.0", x).relu()) + x


def gate(state: State, name: str, level: int, guide: Tensor, old: Tensor) -> Tensor:
    weight = state[f"{name}.generate_kernel{level + 1}.weight"]
    n, channels, frames, height, width = old.shape
    kernel = F.conv2d(guide[:, None], weight, stride=(4, 2, 1)[level], padding=1).relu()
    kernel = kernel.reshape(n, channels, 9, height, width)
    similarity = []
    for t in range(frames):
        neighbours = F.unfold(old[:, :, t], 3, padding=1).reshape(n, channels, 9, height, width)
        similarity.append(torch.sigmoid((kernel * neighbours).sum(2)))
    return torch.stack(similarity, dim=2) * old
