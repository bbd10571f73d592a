"""Saturation: the pixels' wells are full below the converter's full scale."""

from __future__ import annotations

import math

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class Saturation(SensorEffect):
    """The signal is cut off at ``level``, with its noise: mean and variance are those of a Gaussian clipped above.

    Args:
        level: fraction of full scale, 0 to 1; at 1 there is no saturation before the converter clips.
    """

    name = "saturation"
    rank = 53
    ceiling = "level"
    about = {"level": Parameter("full scale", 1.0, 0, 1, step=0.005, starts=(0.9995, 0.985, 0.95, 0.85, 0.7, 0.55))}
    sentence = "the sensor saturates at {level} of full scale"
    level: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        if float(self.level.detach()) >= 1:
            return signal
        beyond = signal.mean - self.level
        deviation = (signal.variance + 1e-12).sqrt()
        z = (beyond / deviation).clamp(-30, 30)
        below = torch.special.ndtr(-z)
        edge = torch.exp(-z.square() / 2) / math.sqrt(2 * math.pi)
        above = torch.special.ndtr(z)
        mean = beyond * below - deviation * edge
        # E[x^2] - E[x]^2, written so that large terms do not cancel; far below the level it is the signal's variance
        variance = beyond.square() * below * above + deviation.square() * (below - edge.square())
        variance = variance - beyond * deviation * edge * (above - below)
        return signal.with_moments(self.level + mean, variance.clamp(min=0))
