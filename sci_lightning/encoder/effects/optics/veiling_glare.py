"""Veiling glare: some of the light spreads over the whole image."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.signal import Signal


class VeilingGlare(OpticsEffect):
    r"""A part of the light is spread evenly: :math:`(1 - f)\, x + f\, \bar x`, the mean over the image.

    In a window of the field, the mean is that of the window.

    Args:
        fraction: f, 0 to 1.
    """

    name = "veiling_glare"
    rank = 42
    about = {"fraction": Parameter("1", 0.0, 0, 1, step=0.005, starts=(0.05,))}
    sentence = "{fraction} of the light is spread evenly over the image"
    fraction: torch.Tensor

    def form(self, signal: Signal) -> Signal:
        even = signal.mean.mean((-2, -1), keepdim=True)
        return signal.with_mean((1 - self.fraction) * signal.mean + self.fraction * even)

    def undo(self, signal: Signal) -> Signal:
        even = signal.mean.mean((-2, -1), keepdim=True)
        return signal.with_mean((signal.mean - self.fraction * even) / (1 - self.fraction).clamp(min=0.05))
