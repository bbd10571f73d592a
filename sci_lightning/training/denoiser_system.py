"""The LightningModule that trains the denoiser of an iterative decoder to remove Gaussian noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.training.system import System


class DenoiserSystem(System):
    """Trains the denoiser alone, on white Gaussian noise; validation and test decode with it as any system does.

    The noise of every batch has one standard deviation, drawn uniformly from a range. The mask is not trained.

    Args:
        encoder: the encoder of validation and test.
        decoder: an iterative decoder, whose denoiser is trained.
        noise: smallest and largest standard deviation, in units of the video.
        others: the further arguments of :class:`~sci_lightning.training.system.System`.

    Raises:
        BadInput: a decoder without a denoiser, or a range whose ends are not in order; in training, as :class:`System`.

    Source: Zhang, Zuo and Zhang, IEEE Trans. Image Processing 2018 (strengths 0 to 75 of 255).
    """

    def __init__(
        self, encoder: Encoder, decoder: Decoder, *, noise: Sequence[float] = (0.0, 75 / 255), **others: Any
    ) -> None:
        if not isinstance(decoder, Iterative):
            raise BadInput(f"system=denoiser: {type(decoder).__name__} has no denoiser; choose decoder=pnp_ffdnet")
        if len(noise) != 2 or not 0 <= noise[0] < noise[1]:
            raise BadInput(f"system.noise={list(noise)}: give the smallest and the largest deviation, as [0,0.3]")
        super().__init__(encoder.requires_grad_(False), decoder, **others)
        self.noise = tuple(noise)
        denoise = decoder.denoiser.forward
        self.stages = lambda noisy, strength: [denoise(noisy, strength)]

    def observe(self, video: torch.Tensor) -> tuple[torch.Tensor, float]:
        """Return clips ``(N, T, h, w)`` with noise of one strength, and that strength."""
        low, high = self.noise
        strength = low + (high - low) * float(torch.rand(()))
        return video + strength * torch.randn_like(video), strength
