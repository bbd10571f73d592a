"""Total variation: the nearest video whose gradients are sparse."""

from __future__ import annotations

import torch
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Steps
from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.errors import BadInput

TAU = 0.25
"""Step of the dual variable; Chambolle observed that the projection converges up to this value."""
TOTAL_VARIATION_PIXELS = 2**17
"""Pixels of the frames that are denoised together, of which seven arrays stay in the processor's cache."""


class TotalVariation(Denoiser):
    r"""The minimum over z of :math:`|z - x|^2 / 2 + s \sum |\nabla z|`, frame by frame, with the strength s.

    Chambolle's projection starts from a dual variable p = 0. A step takes the forward differences g of the present z,
    replaces p by (p - tau g) / (1 + tau |g| / s), and z by x less the backward differences of p. No gradients flow
    through it, since everything is computed in place.

    Args:
        steps: number of steps of the projection. The result is that of scikit-image's ``denoise_tv_chambolle`` of
            every frame with ``max_num_iter = steps + 1`` and no tolerance.

    Raises:
        BadInput: the number of steps is below 1.

    Source: Chambolle, "An algorithm for total variation minimization and applications", J. Math. Imaging Vis. 2004.
    """

    def __init__(self, steps: Steps = 5) -> None:
        super().__init__()
        if steps < 1:
            raise BadInput(f"decoder.denoiser.steps={steps}: must be at least 1")
        self.steps = steps
        self.receptive_field = steps + 1

    @torch.no_grad()
    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Denoise all frames ``(N, T, H, W)``; ``strength`` is in units of the video, and more is smoother."""
        if not self.plain_formulas:
            return self._in_place(video, strength)
        denoised, dual = video, torch.zeros(2, *video.shape, dtype=video.dtype, device=video.device)
        for _ in range(self.steps):
            gradient = _gradient(denoised)
            norm = gradient.square().sum(0).sqrt()
            dual = (dual - TAU * gradient) / (1 + TAU / strength * norm)
            denoised = video - _backward_differences(dual)
        return denoised

    def _in_place(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Return the same, computed in place on as many frames as fit the cache."""
        denoised = torch.empty_like(video, memory_format=torch.contiguous_format)  # so that parts of it are views
        frames, results = (batch.reshape(-1, *video.shape[-2:]) for batch in (video, denoised))
        together = max(1, TOTAL_VARIATION_PIXELS // frames[0].numel())
        number = together if video.device.type in ("cpu", "meta") else len(frames)  # on meta memory is counted
        for part, result in zip(frames.split(number), results.split(number), strict=True):
            _denoise_into(result, part, strength, self.steps)
        return denoised


def _gradient(video: torch.Tensor) -> torch.Tensor:
    """Return the forward differences ``(2, .., H, W)`` down and right, 0 across the last row and column."""
    return torch.stack([F.pad(video.diff(dim=-2), (0, 0, 0, 1)), F.pad(video.diff(dim=-1), (0, 1))])


def _backward_differences(dual: torch.Tensor) -> torch.Tensor:
    """Return the sum ``(.., H, W)`` of the backward differences of ``(2, .., H, W)``, with zeros before the first."""
    down, right = dual
    return down - F.pad(down[..., :-1, :], (0, 0, 1, 0)) + right - F.pad(right[..., :-1], (1, 0))


def _denoise_into(result: torch.Tensor, frames: torch.Tensor, strength: float, steps: int) -> None:
    """Denoise ``frames`` into ``result``."""
    scaled = frames * (TAU / strength)  # so that no factor is left in the rule for the dual variable
    dual = [torch.zeros_like(scaled) for _ in range(2)]
    gradient = [torch.zeros_like(scaled) for _ in range(2)]  # stays 0 across the last row and column
    norm, primal = torch.empty_like(scaled), scaled.clone()
    for _ in range(steps):
        for axis, g in zip((-2, -1), gradient, strict=True):
            inner = primal.shape[axis] - 1
            torch.sub(primal.narrow(axis, 1, inner), primal.narrow(axis, 0, inner), out=g.narrow(axis, 0, inner))
            norm = torch.mul(g, g, out=norm) if axis == -2 else norm.addcmul_(g, g)
        norm.sqrt_().add_(1)
        for axis, p, g in zip((-2, -1), dual, gradient, strict=True):
            inner = primal.shape[axis] - 1
            p.sub_(g).div_(norm)
            torch.sub(scaled if axis == -2 else primal, p, alpha=TAU, out=primal)
            primal.narrow(axis, 1, inner).add_(p.narrow(axis, 0, inner), alpha=TAU)
    torch.mul(primal, strength / TAU, out=result)
