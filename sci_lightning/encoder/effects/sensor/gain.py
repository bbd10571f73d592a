"""Gain: the same light gives more or less signal than nominally."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class Gain(SensorEffect):
    r"""The light is multiplied by a factor before shot noise arises: :math:`m = f \mu`.

    Args:
        factor: 0.01 to 100.
    """

    name = "gain"
    rank = 50
    about = {"factor": Parameter("1", 1.0, 0.01, 100, step=0.01, starts=(0.9, 1.1))}
    sentence = "the sensor's gain is {factor} times the nominal one"
    factor: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        return signal.with_moments(signal.mean * self.factor, signal.variance * self.factor.square())

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean / self.factor)
