"""Batch normalisation whose statistics are those of the weights, never those of the batch."""

from __future__ import annotations

from torch import nn


class FixedNorm(nn.BatchNorm2d):
    """A learned factor and offset per channel after published statistics: mean 0 and variance 1 until they are loaded.

    A denoiser meets videos that are half done and of few frames; their statistics are not those it was trained on.
    """

    def __init__(self, channels: int) -> None:
        super().__init__(channels)
        self.eval()

    def train(self, mode: bool = True) -> FixedNorm:
        return super().train(False)
