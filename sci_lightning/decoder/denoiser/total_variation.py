"""Total variation: the nearest frame whose gradients are sparse."""

from __future__ import annotations

import torch

from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.errors import BadInput

TAU = 0.25
"""Step of the projection in two dimensions, in front of which Chambolle observed it to converge."""


class TotalVariation(Denoiser):
    """Frame by frame, the minimum over z of |z - x|^2 / 2 + strength * sum over the pixels of |gradient of z|.

    No gradients flow through it: everything is computed in place.

    Args:
        steps: of Chambolle's projection; its result is that of scikit-image's ``denoise_tv_chambolle`` with
            ``max_num_iter = steps + 1`` and no tolerance.

    Raises:
        BadInput: no step at all.

    Source: Chambolle, "An algorithm for total variation minimization and applications", J. Math. Imaging Vis. 2004.
    """

    def __init__(self, steps: int = 5) -> None:
        super().__init__()
        if steps < 1:
            raise BadInput(f"decoder.denoiser.steps={steps}: must be at least 1")
        self.steps = steps

    @torch.no_grad()
    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Denoise all frames of all videos at once; ``strength`` is in units of the video, more is smoother."""
        scaled = video * (TAU / strength)  # so that the dual variable's rule has no factor left
        dual = [torch.zeros_like(scaled) for _ in range(2)]
        slope = [torch.zeros_like(scaled) for _ in range(2)]  # 0 across the last row and column for good
        norm, found = torch.empty_like(scaled), scaled.clone()
        for _ in range(self.steps):
            torch.sub(found[..., 1:, :], found[..., :-1, :], out=slope[0][..., :-1, :])
            torch.sub(found[..., 1:], found[..., :-1], out=slope[1][..., :-1])
            torch.mul(slope[0], slope[0], out=norm).addcmul_(slope[1], slope[1]).sqrt_().add_(1)
            for p, g in zip(dual, slope, strict=True):
                p.sub_(g).div_(norm)
            torch.sub(scaled, dual[0], alpha=TAU, out=found).sub_(dual[1], alpha=TAU)
            found[..., 1:, :].add_(dual[0][..., :-1, :], alpha=TAU)
            found[..., 1:].add_(dual[1][..., :-1], alpha=TAU)
        return found.mul_(strength / TAU)
