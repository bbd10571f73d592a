"""A metric that scores single frames and reports the mean over all frames seen."""

from __future__ import annotations

import torch
from torchmetrics import Metric


class FrameMetric(Metric):
    """Mean over frames of :meth:`score`; sums are kept in float64 and added up over processes."""

    is_differentiable = True
    higher_is_better = True
    full_state_update = False
    total: torch.Tensor
    frames: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.add_state("total", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("frames", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    @staticmethod
    def score(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """One value per frame: two ``(..., H, W)`` to ``(...)``."""
        raise NotImplementedError

    def update(self, estimate: torch.Tensor, truth: torch.Tensor) -> None:
        """Add the frames of two ``(..., H, W)`` videos, nominally in [0, 1]."""
        scores = self.score(estimate, truth)
        self.total += scores.sum()
        self.frames += scores.numel()

    def compute(self) -> torch.Tensor:
        return self.total / self.frames
