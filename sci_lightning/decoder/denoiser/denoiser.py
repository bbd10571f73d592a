"""The base class of all denoisers, and batch normalisation for those that are networks."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn


class Denoiser(nn.Module):
    """A denoiser: ``denoiser(video, strength) -> video``.

    Both videos are ``(N, T, H, W)``, nominally in [0, 1] and not clipped. Videos of one batch do not mix.
    """

    plain_formulas: bool = False
    """Whether it is computed by the formulas as they are written, see :mod:`~sci_lightning.decoder.layers.kernels`."""
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


class FixedNorm(nn.BatchNorm2d):
    """Batch normalisation that always uses its stored statistics: mean 0 and variance 1 until weights are loaded.

    Inside an iterative decoder a denoiser gets few frames of unfinished videos, whose statistics differ from those of
    the videos that it was trained on. Before training, :func:`keep_scale` sets the scale instead of statistics.
    """

    def __init__(self, channels: int) -> None:
        super().__init__(channels)
        self.eval()

    def train(self, mode: bool = True) -> FixedNorm:
        return super().train(False)


def keep_scale(network: nn.Module, last: nn.Conv2d) -> None:
    """Set first weights with which convolutions in front of a ReLU keep the scale of their input (He et al., 2015).

    The last convolution, whose output is the noise, starts near zero.

    Args:
        network: all of its convolutions get weights.
        last: the last convolution.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.normal_(last.weight, std=1e-3)
