"""Chambolle's projection for total variation, in place on as many frames as fit the cache."""

from __future__ import annotations

import torch

from sci_lightning.decoder.kernels import block_sizes

AXES = (-2, -1)


def total_variation(video: torch.Tensor, strength: float, steps: int, tau: float) -> torch.Tensor:
    """Return the video ``(.., H, W)`` after ``steps`` steps of the dual variable, see ``TotalVariation``.

    Args:
        video: frames to denoise, each by itself.
        strength: weight of the total variation, in units of the video.
        steps: number of steps.
        tau: length of a step.
    """
    denoised = torch.empty_like(video, memory_format=torch.contiguous_format)  # so that parts of it are views
    frames, results = (batch.reshape(-1, *video.shape[-2:]) for batch in (video, denoised))
    together = max(1, block_sizes.TOTAL_VARIATION_PIXELS // frames[0].numel())
    number = together if video.device.type in ("cpu", "meta") else len(frames)  # on meta memory is counted
    for part, result in zip(frames.split(number), results.split(number), strict=True):
        _denoise_into(result, part, strength, steps, tau)
    return denoised


def _denoise_into(result: torch.Tensor, frames: torch.Tensor, strength: float, steps: int, tau: float) -> None:
    """Denoise ``frames`` into ``result``."""
    scaled = frames * (tau / strength)  # so that no factor is left in the rule for the dual variable
    dual = [torch.zeros_like(scaled) for _ in AXES]
    gradient = [torch.zeros_like(scaled) for _ in AXES]  # stays 0 across the last row and column
    norm, primal = torch.empty_like(scaled), scaled.clone()
    for _ in range(steps):
        for number, (axis, g) in enumerate(zip(AXES, gradient, strict=True)):
            torch.sub(_all_but_first(primal, axis), _all_but_last(primal, axis), out=_all_but_last(g, axis))
            norm = norm.addcmul_(g, g) if number else torch.mul(g, g, out=norm)
        norm.sqrt_().add_(1)
        for number, (axis, p, g) in enumerate(zip(AXES, dual, gradient, strict=True)):
            p.sub_(g).div_(norm)
            torch.sub(primal if number else scaled, p, alpha=tau, out=primal)
            _all_but_first(primal, axis).add_(_all_but_last(p, axis), alpha=tau)
    torch.mul(primal, strength / tau, out=result)


def _all_but_first(frames: torch.Tensor, axis: int) -> torch.Tensor:
    return frames.narrow(axis, 1, frames.shape[axis] - 1)


def _all_but_last(frames: torch.Tensor, axis: int) -> torch.Tensor:
    return frames.narrow(axis, 0, frames.shape[axis] - 1)
