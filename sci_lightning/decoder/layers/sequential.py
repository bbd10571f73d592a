"""Modules one after another: with activation functions, computed again, or under the names of published weights."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import nn
from torch.utils.checkpoint import checkpoint as recompute

_largest_kept: float = 2**21
"""Values of a tensor up to which a training keeps everything: more than any network has at 64 x 64 pixels and T = 8."""


@contextmanager
def computed_as_larger(times: float) -> Iterator[None]:
    """Let tensors count as ``times`` as large, so that a part of a clip shows what the whole costs."""
    global _largest_kept
    before, _largest_kept = _largest_kept, _largest_kept / max(times, 1e-9)
    try:
        yield
    finally:
        _largest_kept = before


def saving_memory(function: Callable[[torch.Tensor], torch.Tensor], x: torch.Tensor, part: nn.Module) -> torch.Tensor:
    """Return ``function(x)``, whose activations are computed again in the backward pass where they are large.

    That is done on processors, of which few have the memory for them; gradients are the same.

    Args:
        function: of little computation and many activations, such as attention.
        x: ``(N, C, T, H, W)``.
        part: the module whose parameters ``function`` may use.
    """
    large = torch.is_grad_enabled() and x.device.type == "cpu" and x.numel() > _largest_kept
    if not large or torch.compiler.is_compiling():
        return function(x)
    result: torch.Tensor = _Recomputed.apply(function, x, *part.parameters())
    return result


class _Recomputed(torch.autograd.Function):
    """What torch's ``checkpoint`` does, which loads torch's compiler, for seconds, before the first step."""

    @staticmethod
    def forward(ctx: Any, function: Any, x: torch.Tensor, *parameters: torch.Tensor) -> torch.Tensor:
        ctx.function = function
        ctx.autocast = {"dtype": torch.get_autocast_dtype("cpu"), "enabled": torch.is_autocast_enabled("cpu")}
        ctx.save_for_backward(x, *parameters)
        result: torch.Tensor = function(x)
        return result

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        x, *parameters = ctx.saved_tensors
        x = x.detach().requires_grad_()
        with torch.enable_grad(), torch.autocast("cpu", **ctx.autocast):
            result = ctx.function(x)
        return None, *torch.autograd.grad(result, (x, *parameters), gradient, allow_unused=True)


class Chain(nn.Sequential):
    """``nn.Sequential`` that can train on less memory, with the same gradients.

    Args:
        modules: each takes and returns one tensor.
        checkpoint: keep only the tensors that pass from module to module, and compute all other activations again in
            the backward pass, which takes about a third more time.
    """

    def __init__(self, modules: Iterable[nn.Module], checkpoint: bool = False) -> None:
        super().__init__(*modules)
        self.checkpoint = checkpoint

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        for module in self:
            again = self.checkpoint and torch.is_grad_enabled()
            x = recompute(module, x, use_reentrant=False) if again else module(x)
        return x


def leaky_relu_after_all(*layers: nn.Module) -> nn.Sequential:
    """Return layers in sequence with a leaky ReLU behind each."""
    return nn.Sequential(*(module for layer in layers for module in (layer, nn.LeakyReLU(inplace=True))))


def leaky_relu_between(*layers: nn.Module) -> nn.Sequential:
    """Return layers in sequence with a leaky ReLU behind each but the last."""
    return nn.Sequential(*leaky_relu_after_all(*layers[:-1]), layers[-1])


def named_block(name: str, *layers: nn.Module, **after: nn.Module) -> nn.Sequential:
    """Return layers in sequence whose state-dict keys begin with ``name.0``, ``name.1`` and so on, as published.

    Args:
        name: of the block.
        layers: in the block.
        after: further modules behind the block, under their own names.
    """
    return nn.Sequential(OrderedDict({name: nn.Sequential(*layers)}, **after))
