"""Rounding, and straight-through gradients across it."""

from __future__ import annotations

import torch


def round_half_up(x: torch.Tensor) -> torch.Tensor:
    """Round ``x`` (any shape) to the nearest integer, halves up; exact for every float, without gradient.

    ``floor(x + 0.5)``, as the paper prints it, is wrong for the largest float below one half,
    because the sum is rounded before the floor sees it.
    """
    lower = torch.floor(x)
    return lower + (x - lower >= 0.5).to(x.dtype)


def straight_through(value: torch.Tensor, source: torch.Tensor) -> torch.Tensor:
    """Return ``value`` with the gradient of ``source``: the straight-through estimator.

    Args:
        value: the discrete result, of the shape of ``source``; returned bit for bit.
        source: what the gradient flows to (Hubara et al., 2016; Algorithm 1 of the paper, "Backward").
    """
    return value.detach() + (source - source.detach())
