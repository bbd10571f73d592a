"""Photo-response non-uniformity (PRNU): every pixel has a gain of its own."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.map_effect import ChartEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.signal import Signal


class Prnu(ChartEffect):
    r"""Light times :math:`1 + s\, c`, the map c the same in every capture, of mean 0 and standard deviation 1.

    Args:
        std: s, standard deviation of the gains, 0 to 1.
        size, file, seed: of the map, see :class:`ChartEffect`.
    """

    name = "prnu"
    stage = "sensor"
    rank = 51
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    sentence = "pixels differ in gain by {std} (standard deviation)"
    chart = "pixel"

    def respond(self, signal: Signal) -> Signal:
        gain = self._gain(signal)
        return signal.with_moments(signal.mean * gain, signal.variance * gain.square())

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean / self._gain(signal).clamp(min=0.05))  # a dead pixel stays dark

    def _gain(self, signal: Signal) -> torch.Tensor:
        return 1 + self.std * signal.window(self.map)
