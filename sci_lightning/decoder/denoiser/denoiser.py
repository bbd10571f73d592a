"""The base class of all denoisers."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn


class Denoiser(nn.Module):
    """A denoiser: ``denoiser(video, strength) -> video``.

    Both videos are ``(N, T, H, W)``, nominally in [0, 1] and not clipped. Videos of one batch do not mix.
    """

    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """As for :class:`~sci_lightning.decoder.decoder.Decoder`, of the denoiser's own state-dict keys."""

    receptive_field: int = 64
    """Pixels around a part of the video, along rows and columns, that its result depends on.

    A denoiser that does not state its own is taken for one of at most 64.
    """
    alignment: int = 1
    """Parts of a video are denoised as the whole is only if they begin at multiples of so many pixels."""

    def reset(self) -> None:
        """Forget what was kept from earlier calls, because other videos follow."""

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Return the video with less noise.

        Args:
            video: ``(N, T, H, W)``.
            strength: positive; for a network the standard deviation of the noise, in units of the video.
        """
        raise NotImplementedError
