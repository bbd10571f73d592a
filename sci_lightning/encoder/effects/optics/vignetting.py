"""Vignetting: less light towards the corners."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.signal import Signal


class Vignetting(OpticsEffect):
    r"""Light is lost as :math:`1 - s\, r^2 / R^2`, r from the field's centre, R at the corner pixel's centre.

    Args:
        strength: s, the part of the light lost in the corner, 0 to 1.
    """

    name = "vignetting"
    rank = 41
    about = {"strength": Parameter("1", 0.0, 0, 1, step=0.01, starts=(0.1,))}
    sentence = "the corners lose {strength} of their light"
    strength: torch.Tensor

    def form(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean * self._falloff(signal))

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean / self._falloff(signal).clamp(min=0.05))  # a dark corner stays dark

    def _falloff(self, signal: Signal) -> torch.Tensor:
        return 1 - self.strength * signal.squared_radius()
