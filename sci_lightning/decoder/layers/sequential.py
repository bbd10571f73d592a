"""Modules one after another: with activations computed again, or under the names of published weights."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable

import torch
from torch import nn
from torch.utils.checkpoint import checkpoint as recompute


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


def named_block(name: str, *layers: nn.Module, **after: nn.Module) -> nn.Sequential:
    """Return layers in sequence whose state-dict keys begin with ``name.0``, ``name.1`` and so on, as published.

    Args:
        name: of the block.
        layers: in the block.
        after: further modules behind the block, under their own names.
    """
    return nn.Sequential(OrderedDict({name: nn.Sequential(*layers)}, **after))
