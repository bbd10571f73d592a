"""What all denoisers have in common: the call."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn


class Denoiser(nn.Module):
    """A denoiser: ``denoiser(video, strength) -> video``, ``(N, T, H, W)`` both, nominally in [0, 1], not clipped.

    Videos of one batch do not mix.
    """

    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """As of :class:`~sci_lightning.decoder.decoder.Decoder`, of the denoiser's own keys."""

    def reset(self) -> None:
        """Forget what earlier calls left behind to go on from: other videos follow."""

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Take away noise.

        Args:
            video: ``(N, T, H, W)``.
            strength: positive; of a network the standard deviation of the noise, in units of the video.
        """
        raise NotImplementedError
