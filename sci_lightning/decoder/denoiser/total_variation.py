"""Total variation: the nearest video whose gradients are sparse."""

from __future__ import annotations

import torch
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Steps
from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.decoder.kernels.switch import are_plain
from sci_lightning.decoder.kernels.total_variation import total_variation
from sci_lightning.errors import BadInput

TAU = 0.25
"""Step of the dual variable; Chambolle observed that the projection converges up to this value."""


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
        if not are_plain():
            return total_variation(video, strength, self.steps, TAU)
        denoised, dual = video, torch.zeros(2, *video.shape, dtype=video.dtype, device=video.device)
        for _ in range(self.steps):
            gradient = _gradient(denoised)
            norm = gradient.square().sum(0).sqrt()
            dual = (dual - TAU * gradient) / (1 + TAU / strength * norm)
            denoised = video - _backward_differences(dual)
        return denoised


def _gradient(video: torch.Tensor) -> torch.Tensor:
    """Return the forward differences ``(2, .., H, W)`` down and right, 0 across the last row and column."""
    return torch.stack([F.pad(video.diff(dim=-2), (0, 0, 0, 1)), F.pad(video.diff(dim=-1), (0, 1))])


def _backward_differences(dual: torch.Tensor) -> torch.Tensor:
    """Return the sum ``(.., H, W)`` of the backward differences of ``(2, .., H, W)``, with zeros before the first."""
    down, right = dual
    return down - F.pad(down[..., :-1, :], (0, 0, 1, 0)) + right - F.pad(right[..., :-1], (1, 0))
