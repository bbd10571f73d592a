"""What a decoder costs: parameters and multiply-accumulates."""

from __future__ import annotations

import torch
from torch import nn
from torch.func import functional_call
from torch.utils.flop_counter import FlopCounterMode


def count_parameters(decoder: nn.Module) -> int:
    """Number of learned values."""
    return sum(parameter.numel() for parameter in decoder.parameters())


def count_macs(decoder: nn.Module, frames: int, height: int, width: int) -> int:
    """Multiply-accumulates of one measurement: convolutions, linear layers and matrix products, exactly.

    Counted by torch on tensors without data, so it costs no computation and no memory, at any size.
    """
    with FlopCounterMode(display=False) as counter:
        call_without_data(decoder, frames, height, width)
    return counter.get_total_flops() // 2


@torch.no_grad()
def call_without_data(decoder: nn.Module, frames: int, height: int, width: int) -> None:
    """Decode one measurement of T = ``frames`` on tensors that have a shape but no values."""
    state = {name: value.to("meta") for name, value in (*decoder.named_parameters(), *decoder.named_buffers())}
    measurement = torch.empty(1, height, width, device="meta")
    mask = torch.empty(frames, height, width, device="meta")
    functional_call(decoder, state, (measurement, mask))
