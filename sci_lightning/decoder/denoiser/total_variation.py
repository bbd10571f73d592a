"""Total variation: the nearest video whose gradients are sparse."""

from __future__ import annotations

import torch

from sci_lightning.configuration.bounds import Steps
from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.errors import BadInput

AXES = (-2, -1)
TAU = 0.25
"""Step of the dual variable; Chambolle observed the projection to converge up to it."""

CACHED = 2**17
"""Pixels that a core works on at a time: its seven arrays of them fit the cache, which is half as fast again."""


class TotalVariation(Denoiser):
    """The minimum over z of |z - x|^2 / 2 + strength * sum over all pixels of |gradient of z|, frame by frame.

    No gradients flow through it: everything is computed in place.

    Args:
        steps: of Chambolle's projection; its result is that of scikit-image's ``denoise_tv_chambolle`` of each frame
            with ``max_num_iter = steps + 1`` and no tolerance.

    Raises:
        BadInput: no step at all.

    Source: Chambolle, "An algorithm for total variation minimization and applications", J. Math. Imaging Vis. 2004.
    """

    def __init__(self, steps: Steps = 5) -> None:
        super().__init__()
        if steps < 1:
            raise BadInput(f"decoder.denoiser.steps={steps}: must be at least 1")
        self.steps = steps

    @torch.no_grad()
    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Denoise all frames of all videos; ``strength`` is in units of the video, more is smoother."""
        denoised = torch.empty_like(video, memory_format=torch.contiguous_format)  # so that parts of it are views
        frames, found = (each.reshape(-1, *video.shape[-2:]) for each in (video, denoised))
        number = len(frames) if video.device.type != "cpu" else max(1, CACHED // frames[0].numel())
        for part, out in zip(frames.split(number), found.split(number), strict=True):
            self._nearest(part, strength, out)
        return denoised

    def _nearest(self, frames: torch.Tensor, strength: float, out: torch.Tensor) -> None:
        """Denoise ``frames`` into ``out``."""
        scaled = frames * (TAU / strength)  # so that the dual variable's rule has no factor left
        dual = [torch.zeros_like(scaled) for _ in AXES]
        slope = [torch.zeros_like(scaled) for _ in AXES]  # 0 across the last row and column for good
        norm, found = torch.empty_like(scaled), scaled.clone()
        for _ in range(self.steps):
            for number, (axis, g) in enumerate(zip(AXES, slope, strict=True)):
                torch.sub(_but_first(found, axis), _but_last(found, axis), out=_but_last(g, axis))
                norm = norm.addcmul_(g, g) if number else torch.mul(g, g, out=norm)
            norm.sqrt_().add_(1)
            for number, (axis, p, g) in enumerate(zip(AXES, dual, slope, strict=True)):
                p.sub_(g).div_(norm)
                torch.sub(found if number else scaled, p, alpha=TAU, out=found)
                _but_first(found, axis).add_(_but_last(p, axis), alpha=TAU)
        torch.mul(found, strength / TAU, out=out)


def _but_first(frames: torch.Tensor, axis: int) -> torch.Tensor:
    return frames.narrow(axis, 1, frames.shape[axis] - 1)


def _but_last(frames: torch.Tensor, axis: int) -> torch.Tensor:
    return frames.narrow(axis, 0, frames.shape[axis] - 1)
