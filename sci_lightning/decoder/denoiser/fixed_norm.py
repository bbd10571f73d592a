"""Batch normalisation with fixed statistics, and the first weights that go with it."""

from __future__ import annotations

from torch import nn


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
