"""First estimates of the video from measurement and mask: what networks take as their input."""

from __future__ import annotations

import torch


def mean_frame(measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Measurement over the mask's sum, ``(N, H, W)``: the frame a motionless scene would have.

    Args:
        measurement: ``(N, H, W)``.
        mask: ``(T, H, W)``; pixels that never open divide by 1.
    """
    return measurement / mask_total(mask)


def mean_video(measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """:func:`mean_frame` in every slot, ``(N, T, H, W)``: the baseline any decoder must beat."""
    return mean_frame(measurement, mask).unsqueeze(1).expand(-1, mask.shape[0], -1, -1)


def mask_total(mask: torch.Tensor, squared: bool = False) -> torch.Tensor:
    """Sum over time of the mask ``(T, H, W)``, or of its square, ``(H, W)``: a divisor, 1 where no slot opens."""
    total = (mask.square() if squared else mask).sum(0)
    return torch.where(total == 0, torch.ones_like(total), total)
