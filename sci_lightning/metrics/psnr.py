"""Peak signal-to-noise ratio per frame."""

from __future__ import annotations

import torch

from sci_lightning.metrics.frame_metric import FrameMetric


def psnr(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return ``-10 log10(mean squared error)`` of every frame, in dB.

    Args:
        estimate, truth: ``(..., H, W)`` on the scale where 1.0 is white; the estimate is neither clipped nor rounded.

    Returns:
        float64 ``(...)``; a frame without any error gets 100, as in the published evaluations.
    """
    error = (estimate.double() - truth.double()).square().mean((-2, -1))
    return torch.where(error == 0, 100.0, -10 * torch.log10(error.clamp(min=1e-300)))


class PSNR(FrameMetric):
    """The mean over frames of :func:`psnr`, in dB."""

    score = staticmethod(psnr)
