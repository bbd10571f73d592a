"""The step of unfolding networks that knows the physics: an estimate is drawn to what was measured."""

from __future__ import annotations

import torch


def snapshot(video: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """What the mask makes of a video: sum over t of M_t x_t, ``(N, T, H, W)`` to ``(N, H, W)``."""
    first, *others = zip(mask, video.unbind(1), strict=True)
    total = torch.mul(*first)
    for slot, frame in others:  # no product of the video's size in between: fresh memory costs more than the sum
        total = torch.addcmul(total, slot, frame)
    return total


def data_step(video: torch.Tensor, measurement: torch.Tensor, mask: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """x + M * (y - sum of M x) / weight.

    With R, the sum of M squared, as weight: the nearest video that explains the measurement (GAP). With R + gamma: the
    minimum over z of |y - sum of M z|^2 + gamma |z - x|^2 (ADMM, half-quadratic splitting). Several published networks
    have the sum of M in place of R: the same for binary masks, less than the whole way for gray ones.

    Args:
        video: x, ``(N, T, H, W)``.
        measurement: y, ``(N, H, W)``.
        mask: M, ``(T, H, W)``.
        weight: ``(H, W)``; R is ``mask_total(mask, squared=True)`` of ``initial_estimate``.

    Source: Liao, Li and Carin, "Generalized alternating projection for weighted-l2,1 minimization with applications to
    model-based compressive sensing", SIAM J. Imaging Sciences 2014.
    """
    return torch.addcmul(video, mask, ((measurement - snapshot(video, mask)) / weight).unsqueeze(1))
