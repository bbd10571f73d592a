"""What a decoder costs: parameters and multiply-accumulates."""

from __future__ import annotations

import copy

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode


def count_parameters(decoder: nn.Module) -> int:
    """Number of learned values."""
    return sum(parameter.numel() for parameter in decoder.parameters())


@torch.no_grad()
def count_macs(decoder: nn.Module, frames: int, height: int, width: int) -> int:
    """Multiply-accumulates of one measurement: convolutions, linear layers and matrix products, exactly.

    Counted by torch on tensors without data, so it costs no computation and no memory, at any size.
    """
    shadow = copy.deepcopy(decoder).to("meta")
    measurement = torch.empty(1, height, width, device="meta")
    mask = torch.empty(frames, height, width, device="meta")
    with FlopCounterMode(display=False) as counter:
        shadow(measurement, mask)
    return counter.get_total_flops() // 2
