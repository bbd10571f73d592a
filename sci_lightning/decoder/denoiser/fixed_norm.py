"""Batch normalisation whose statistics are those of the weights, never those of the batch."""

from __future__ import annotations

from torch import nn


class FixedNorm(nn.BatchNorm2d):
    """A learned factor and offset per channel after published statistics: mean 0 and variance 1 until they are loaded.

    A denoiser meets videos that are half done and of few frames; their statistics are not those it was trained on.
    Before training, :func:`keep_scale` does what no statistics do here.
    """

    def __init__(self, channels: int) -> None:
        super().__init__(channels)
        self.eval()

    def train(self, mode: bool = True) -> FixedNorm:
        return super().train(False)


def keep_scale(network: nn.Module, last: nn.Conv2d) -> None:
    """First weights with which every convolution in front of a ReLU passes its input's scale on (He et al., 2015).

    The last one, which tells the noise, starts from almost none.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.normal_(last.weight, std=1e-3)
