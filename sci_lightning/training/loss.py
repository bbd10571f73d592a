"""Losses of a reconstructed video ``(N, T, H, W)`` against the true one, by their names in ``system.loss=``."""

from __future__ import annotations

from collections.abc import Callable

import torch


def mse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error (the paper's Eq. 6)."""
    return (estimate - truth).square().mean()


def rmse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the root of the mean squared error (what the released training code minimises)."""
    return mse(estimate, truth).sqrt()


def frame_rmse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the mean over frames of the root of each one's mean squared error: as PSNR does, it weighs easy frames."""
    return (estimate - truth).square().mean((-2, -1)).sqrt().mean()


LOSSES: dict[str, Callable[[torch.Tensor, torch.Tensor], torch.Tensor]] = {
    "mse": mse,
    "rmse": rmse,
    "frame_rmse": frame_rmse,
}
