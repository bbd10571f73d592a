"""The cost of a decoder: number of parameters and of multiply-accumulate operations."""

from __future__ import annotations

import torch
from torch import nn
from torch.func import functional_call
from torch.utils.flop_counter import FlopCounterMode

from sci_lightning.decoder.decoder import Decoder


def count_parameters(decoder: nn.Module) -> int:
    """Return the number of values in all parameters of a decoder."""
    return sum(parameter.numel() for parameter in decoder.parameters())


def count_macs(decoder: nn.Module, frames: int, height: int, width: int) -> int:
    """Return the multiply-accumulates for one measurement: convolutions, linear layers and matrix products, exactly.

    torch counts them on tensors without data, so that this takes neither time nor memory at any size.

    Args:
        decoder: any network.
        frames, height, width: T, H and W of the measurement.
    """
    with FlopCounterMode(display=False) as counter:
        call_without_data(decoder, frames, height, width)
    return counter.get_total_flops() // 2


@torch.no_grad()
def call_without_data(decoder: nn.Module, frames: int, height: int, width: int) -> None:
    """Decode one measurement of T = ``frames`` on tensors that have a shape but no values (device ``meta``)."""
    decoder = decoder.counted() if isinstance(decoder, Decoder) else decoder
    state = {name: value.to("meta") for name, value in (*decoder.named_parameters(), *decoder.named_buffers())}
    measurement = torch.empty(1, height, width, device="meta")
    mask = torch.empty(frames, height, width, device="meta")
    functional_call(decoder, state, (measurement, mask))
