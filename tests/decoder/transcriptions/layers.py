"""Layers looked up by name in a state dict, as torch's functions."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional as F

State = dict[str, Tensor]


def conv2d(state: State, name: str, x: Tensor, stride: int = 1) -> Tensor:
    weight = state[f"{name}.weight"]
    return F.conv2d(x, weight, state.get(f"{name}.bias"), stride, weight.shape[-1] // 2)


def conv3d(state: State, name: str, x: Tensor, stride: int = 1, groups: int = 1) -> Tensor:
    weight = state[f"{name}.weight"]
    padding = tuple(side // 2 for side in weight.shape[2:])
    return F.conv3d(x, weight, state.get(f"{name}.bias"), (1, stride, stride), padding, groups=groups)


def linear(state: State, name: str, x: Tensor) -> Tensor:
    return F.linear(x, state[f"{name}.weight"], state.get(f"{name}.bias"))


def norm(state: State, name: str, x: Tensor) -> Tensor:
    """Over the last dimension."""
    return F.layer_norm(x, x.shape[-1:], state[f"{name}.weight"], state[f"{name}.bias"])


def leaky(x: Tensor) -> Tensor:
    return F.leaky_relu(x, 0.01)


def up2d(state: State, name: str, x: Tensor) -> Tensor:
    """A transposed 3x3 convolution of stride 2 that doubles H and W."""
    return F.conv_transpose2d(x, state[f"{name}.weight"], state[f"{name}.bias"], 2, 1, 1)


def up3d(state: State, name: str, x: Tensor) -> Tensor:
    """The same for every frame of a video."""
    weight, bias = state[f"{name}.weight"], state[f"{name}.bias"]
    return F.conv_transpose3d(x, weight, bias, (1, 2, 2), (0, 1, 1), (0, 1, 1))
