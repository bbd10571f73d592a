"""Response gamma: the signal is a power of the light."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class ResponseGamma(SensorEffect):
    r"""Out = in ** gamma, for the signal with its noise: mean and variance follow from the two points m ± sigma.

    Args:
        gamma: the exponent, 0.1 to 10.
    """

    name = "response_gamma"
    rank = 54
    about = {"gamma": Parameter("1", 1.0, 0.1, 10, step=0.01, starts=(0.8, 1.25))}
    sentence = "the sensor responds with the power {gamma} of the light"
    gamma: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        deviation = (signal.variance + 1e-12).sqrt()
        above, below = (_power(signal.mean + side, self.gamma) for side in (deviation, -deviation))
        return signal.with_moments((above + below) / 2, (above - below).square() / 4)

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(_power(signal.mean, 1 / self.gamma))


def _power(x: torch.Tensor, exponent: torch.Tensor) -> torch.Tensor:
    """Return the power as an odd function with a finite slope at 0."""
    return x * (x.square() + 1e-8) ** ((exponent - 1) / 2)
