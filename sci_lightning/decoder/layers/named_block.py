"""Layers under the name that they have in published weights."""

from __future__ import annotations

from collections import OrderedDict

from torch import nn


def named_block(name: str, *layers: nn.Module, **after: nn.Module) -> nn.Sequential:
    """``layers`` in a row, with state-dict keys ``name.0...``, ``name.1...``; then those of ``after``, by name."""
    return nn.Sequential(OrderedDict({name: nn.Sequential(*layers)}, **after))
