"""Image taps: the modulated image is smeared by a small free kernel."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.empirical.empirical import Empirical, window_of_taps
from sci_lightning.encoder.signal import Signal


class ImageTaps(Empirical, OpticsEffect):
    """Light of every pixel also falls on its neighbours, 5 x 5 but the middle.

    Args:
        count: 24.
        values: the neighbours' shares, row by row.
    """

    name = "image_taps"
    rank = 43
    where = "the image is smeared"
    number = Parameter("1", 0.0, -1, 1, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 24

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        kernel = window_of_taps(self.coefficients.to(signal.mean)).flip(-1, -2)
        return signal.with_mean(torch.nn.functional.conv2d(signal.mean[:, None], kernel, padding="same")[:, 0])
