"""Total variation: the nearest video whose gradients are sparse."""

from __future__ import annotations

import torch

from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.errors import BadInput

ROWS, COLUMNS, TIME = -2, -1, -3

CACHED = 2**17
"""Pixels that a core works on at a time: its seven arrays of them fit the cache, which is half as fast again."""


class TotalVariation(Denoiser):
    """The minimum over z of |z - x|^2 / 2 + strength * sum over all pixels of |gradient of z|.

    No gradients flow through it: everything is computed in place.

    Args:
        steps: of Chambolle's projection; its result is that of scikit-image's ``denoise_tv_chambolle`` with
            ``max_num_iter = steps + 1`` and no tolerance: of each frame by itself without ``temporal``, of each video
            ``(T, H, W)`` with 1.
        temporal: how much a difference between neighbouring frames counts, beside one between neighbouring pixels; 0
            leaves every frame to itself.

    Raises:
        BadInput: no step at all, a weight outside 0 to 1.

    Source: Chambolle, "An algorithm for total variation minimization and applications", J. Math. Imaging Vis. 2004.
    """

    def __init__(self, steps: int = 5, temporal: float = 0.0) -> None:
        super().__init__()
        if steps < 1:
            raise BadInput(f"decoder.denoiser.steps={steps}: must be at least 1")
        if not 0 <= temporal <= 1:
            raise BadInput(f"decoder.denoiser.temporal={temporal}: must lie between 0 (frame by frame) and 1")
        self.steps = steps
        self.axes = ((ROWS, 1.0), (COLUMNS, 1.0), (TIME, float(temporal)))[: 3 if temporal else 2]

    @torch.no_grad()
    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Denoise all frames of all videos; ``strength`` is in units of the video, more is smoother."""
        denoised = torch.empty_like(video, memory_format=torch.contiguous_format)  # so that parts of it are views
        if len(self.axes) > 2 or video.device.type != "cpu":
            self._nearest(video, strength, denoised)
        else:
            frames = [each.reshape(-1, *video.shape[-2:]) for each in (video, denoised)]
            number = max(1, CACHED // frames[0][0].numel())
            for part, out in zip(*(each.split(number) for each in frames), strict=True):
                self._nearest(part, strength, out)
        return denoised

    def _nearest(self, video: torch.Tensor, strength: float, out: torch.Tensor) -> None:
        """Denoise ``video`` into ``out``."""
        tau = 0.5 / len(self.axes)  # Chambolle observed the projection to converge up to it
        scaled = video * (tau / strength)  # so that the dual variable's rule has no factor left
        dual = [torch.zeros_like(scaled) for _ in self.axes]
        slope = [torch.zeros_like(scaled) for _ in self.axes]  # 0 across the last row, column, frame for good
        norm, found = torch.empty_like(scaled), scaled.clone()
        for _ in range(self.steps):
            for number, ((axis, weight), g) in enumerate(zip(self.axes, slope, strict=True)):
                ahead = torch.sub(_but_first(found, axis), _but_last(found, axis), out=_but_last(g, axis))
                if weight != 1:
                    ahead.mul_(weight)
                norm = norm.addcmul_(g, g) if number else torch.mul(g, g, out=norm)
            norm.sqrt_().add_(1)
            for number, ((axis, weight), p, g) in enumerate(zip(self.axes, dual, slope, strict=True)):
                p.sub_(g).div_(norm)
                torch.sub(found if number else scaled, p, alpha=tau * weight, out=found)
                _but_first(found, axis).add_(_but_last(p, axis), alpha=tau * weight)
        torch.mul(found, strength / tau, out=out)


def _but_first(video: torch.Tensor, axis: int) -> torch.Tensor:
    return video.narrow(axis, 1, video.shape[axis] - 1)


def _but_last(video: torch.Tensor, axis: int) -> torch.Tensor:
    return video.narrow(axis, 0, video.shape[axis] - 1)
