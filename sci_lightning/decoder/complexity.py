"""The cost of a decoder: parameters, multiply-accumulates, and these as the paper's table counts them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn
from torch.func import functional_call
from torch.nn import functional as F
from torch.nn.modules.conv import _ConvNd
from torch.overrides import TorchFunctionMode
from torch.utils.flop_counter import FlopCounterMode
from torch.utils.hooks import RemovableHandle

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.layers import kernels
from sci_lightning.errors import BadInput

RULES = (2022, 2020)
"""Versions of the counter (thop), by year, whose results the paper's table mixes."""


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


def count_as_paper(decoder: nn.Module, frames: int, height: int, width: int, rules: int = 2022) -> int:
    """Return the multiply-accumulates ("FLOPs") for one measurement by the rules of the counter that the paper used.

    ======================  =======================================================================
    convolution             elements of the output x values of one kernel (padding counts as well)
    transposed convolution  the same formula, so a stride s makes it s * s times what is computed
    linear layer            elements of the output x width of the input
    softmax of n values     3n - 1, as a layer or in torch's attention, of which nothing else is
                            counted; the counter did not see softmax called as a function, nor ``@``
    layer normalisation     4 for each element with scale and shift (2 without); by the rules of 2020: 2
    bias of a convolution   by the rules of 2020: 1 for each element of the output; else nothing
    LeakyReLU               by the rules of 2020: 1 for each element; else nothing
    everything else         nothing
    ======================  =======================================================================

    A convolution layer (any subclass of torch's) counts by what it is, however it computes that: as a two-dimensional
    one over stacked frames, say. The rest is counted where torch's functions are called, whatever calls them. The
    tensors have no data, so it costs nothing.

    Args:
        decoder: any network.
        frames, height, width: T, H and W of the measurement.
        rules: 2022, behind E2E-CNN, Res2former and Res2former-L in the paper's Table 4; or 2020, behind RevSCI and
            STFormer.

    Raises:
        BadInput: there are no such rules.
    """
    if rules not in RULES:
        raise BadInput(f"rules={rules!r}: the paper's figures follow the rules of {' or '.join(map(str, RULES))}")
    with kernels.plainly(decoder), _Counter(decoder, rules) as counter:  # the same count by fewer calls
        call_without_data(decoder, frames, height, width)
    return counter.total


class _Counter(TorchFunctionMode):
    """While it is active, adds up the cost of convolution layers and of the torch functions called outside of them."""

    def __init__(self, decoder: nn.Module, rules: int) -> None:
        super().__init__()
        self.layers = [layer for layer in decoder.modules() if isinstance(layer, _ConvNd)]
        self.rules = rules
        self.total = 0
        self.inside = False
        self.hooks: list[RemovableHandle] = []

    def __enter__(self) -> _Counter:
        for layer in self.layers:
            self.hooks += [layer.register_forward_pre_hook(self._enter), layer.register_forward_hook(self._leave)]
        super().__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        for hook in self.hooks:
            hook.remove()

    def _enter(self, layer: nn.Module, inputs: Any) -> None:
        self.inside = True

    def _leave(self, layer: Any, inputs: Any, result: Tensor) -> None:
        self.inside = False
        self.total += _convolution(self.rules, result, inputs[0], layer.weight, layer.bias)

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = function(*args, **(kwargs or {}))
        cost = None if self.inside else COSTS.get(function)
        if cost is not None:
            self.total += cost(self.rules, result, *args, **(kwargs or {}))
        return result


def _convolution(
    rules: int, result: Tensor, x: Tensor, weight: Tensor, bias: Tensor | None = None, *_: Any, **__: Any
) -> int:
    channels = result.shape[1 - weight.ndim]
    return result.numel() * (weight.numel() // channels + (rules == 2020 and bias is not None))


def _linear(rules: int, result: Tensor, x: Tensor, weight: Tensor, bias: Tensor | None = None) -> int:
    return result.numel() * weight.shape[1]


def _softmax(rules: int, result: Tensor, x: Tensor, dim: int, *_: Any, **__: Any) -> int:
    return _softmax_rows(result.numel(), result.shape[dim])


def _attention(rules: int, result: Tensor, query: Tensor, key: Tensor, *_: Any, **__: Any) -> int:
    return _softmax_rows(query.shape[:-1].numel() * key.shape[-2], key.shape[-2])


def _softmax_rows(elements: int, length: int) -> int:
    return elements // length * (3 * length - 1)


def _layer_norm(
    rules: int, result: Tensor, x: Tensor, normalized_shape: Any, weight: Tensor | None = None, *_: Any, **__: Any
) -> int:
    return result.numel() * (4 if rules == 2022 and weight is not None else 2)


def _leaky_relu(rules: int, result: Tensor, *_: Any, **__: Any) -> int:
    return result.numel() if rules == 2020 else 0


COSTS: dict[Callable[..., Tensor], Callable[..., int]] = {
    **{getattr(F, f"conv{kind}{n}d"): _convolution for kind in ("", "_transpose") for n in (1, 2, 3)},
    F.linear: _linear,
    F.softmax: _softmax,  # not torch.softmax: see above
    F.scaled_dot_product_attention: _attention,
    F.layer_norm: _layer_norm,
    F.leaky_relu: _leaky_relu,
    F.leaky_relu_: _leaky_relu,
}
"""Cost by function of torch; it is called with the rules, the result and the function's own arguments."""
