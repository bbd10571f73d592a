"""Losses of a reconstructed video ``(N, T, H, W)`` against the true one, by their names in ``system.loss=``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from sci_lightning.errors import BadInput


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


class StageLoss:
    """The weighted sum of the losses of a decoder's last stages.

    Args:
        name: ``mse``, ``rmse`` or ``frame_rmse``.
        weights: of the last stages, in their order.

    Raises:
        BadInput: no such loss, no weights or one that is not positive; when called, more weights than stages.
    """

    def __init__(self, name: str, weights: Sequence[float]) -> None:
        if name not in LOSSES:
            raise BadInput(f"system.loss={name}: no such loss; choose one of {', '.join(LOSSES)}")
        if not weights or min(weights) <= 0:
            raise BadInput(f"system.stage_weights={list(weights)}: give one or more positive numbers, as [0.5,1]")
        self.of_video, self.weights = LOSSES[name], tuple(weights)

    def __call__(self, stages: Sequence[torch.Tensor], video: torch.Tensor) -> torch.Tensor:
        """Return the loss of estimates ``(N, T, h, w)`` from first to last against the video."""
        if len(self.weights) > len(stages):
            raise BadInput(
                f"system.stage_weights={list(self.weights)}: {len(self.weights)} weights, but this decoder estimates "
                f"in {len(stages)} stage{'s' * (len(stages) > 1)}; give at most as many"
            )
        losses = [self.of_video(stage, video) for stage in stages[-len(self.weights) :]]
        return torch.stack([weight * loss for weight, loss in zip(self.weights, losses, strict=True)]).sum()
