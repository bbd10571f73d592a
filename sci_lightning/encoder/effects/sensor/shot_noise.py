"""Shot noise: photons are counted one by one."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class ShotNoise(SensorEffect):
    r"""Poisson noise of the electrons: the variance grows by :math:`x / W`, in units of full scale squared.

    Args:
        full_well: W, electrons at full scale, 1 to 1e9; at 1e9 there is no noise.
    """

    name = "shot_noise"
    rank = 52
    about = {"full_well": Parameter("electrons", 1e9, 1, 1e9, step=0.02, starts=(1e3, 1e4, 1e5), log=True)}
    sentence = "the full well holds {full_well} electrons"
    noise = True
    sensor_argument = "full_well"
    full_well: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        if float(self.full_well.detach()) >= 1e9:
            return signal
        return signal.with_moments(signal.mean, signal.variance + signal.mean.clamp(min=0) / self.full_well)
