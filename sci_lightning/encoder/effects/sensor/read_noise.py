"""Read noise: noise of the readout amplifier."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class ReadNoise(SensorEffect):
    r"""Gaussian noise that does not depend on the light: the variance grows by :math:`\sigma^2`.

    Args:
        std: standard deviation in DN, 0 to 1000.
    """

    name = "read_noise"
    rank = 59
    about = {"std": Parameter("DN", 0.0, 0, 1000, step=0.03, starts=(0.5, 1.5, 4.0))}
    sentence = "the read noise is {std} DN"
    noise = True
    sensor_argument = "read_noise"
    std: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        return signal.with_moments(signal.mean, signal.variance + (self.std * signal.dn).square())
