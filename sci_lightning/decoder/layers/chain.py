"""Modules one after another, with activations kept or computed again."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import nn
from torch.utils.checkpoint import checkpoint as computed_again


class Chain(nn.Sequential):
    """``nn.Sequential`` that can train on less memory, with the same gradients.

    Args:
        modules: each a function of one tensor.
        checkpoint: keep what passes between the modules only, and compute the rest again in the backward pass, for
            about a third more time.
    """

    def __init__(self, modules: Iterable[nn.Module], checkpoint: bool = False) -> None:
        super().__init__(*modules)
        self.checkpoint = checkpoint

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        for module in self:
            again = self.checkpoint and torch.is_grad_enabled()
            x = computed_again(module, x, use_reentrant=False) if again else module(x)
        return x
