"""Peak signal-to-noise ratio per frame."""

from __future__ import annotations

import torch

from sci_lightning.metrics.frame_metric import FrameMetric, as_videos

LEAST_ERROR = 1e-10
"""Mean squared error that counts as none: 100 dB."""


def psnr(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return ``-10 log10(mean squared error)`` of every frame, in dB.

    Args:
        estimate, truth: ``(..., H, W)`` on the scale where 1.0 is white; the estimate is neither clipped nor rounded.

    Returns:
        float64 ``(...)``, at most 100: a frame without any error gets that, as in the published evaluations, and none
        with an error gets more.
    """
    estimate, truth = as_videos(estimate, truth)
    error = (estimate.double() - truth.double()).square().mean((-2, -1))
    return -10 * torch.log10(error.clamp(min=LEAST_ERROR))


class PSNR(FrameMetric):
    """The mean over frames of :func:`psnr`, in dB."""

    score = staticmethod(psnr)
