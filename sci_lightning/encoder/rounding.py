"""Rounding that a gradient can cross."""

from __future__ import annotations

import torch


def round_half_up(x: torch.Tensor) -> torch.Tensor:
    """Nearest integer of ``x`` (any shape), halves up; exact for every float, no gradient.

    ``floor(x + 0.5)``, as the paper prints it, is wrong for the largest float below one half,
    because the sum is rounded before the floor sees it.
    """
    lower = torch.floor(x)
    return lower + (x - lower >= 0.5).to(x.dtype)


def straight_through(value: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
    """``value`` in the forward pass, the identity on ``source`` in the backward pass.

    Args:
        value: the discrete result, same shape as ``source``; returned bit for bit.
        source: what the gradient flows to (Hubara et al., 2016; Algorithm 1 of the paper, "Backward").
    """
    return value.detach() + (source - source.detach())
