"""Black level: the dark signal is not at the converter's zero."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class BlackLevel(SensorEffect):
    """The same offset in every pixel and capture; with a negative one, dark pixels are clipped at 0.

    Args:
        offset: fraction of full scale, -1 to 1.
    """

    name = "black_level"
    rank = 55
    about = {"offset": Parameter("full scale", 0.0, -1, 1, step=0.002, starts=(-0.02, 0.02))}
    sentence = "black is recorded as {offset} of full scale"
    offset: torch.Tensor

    def respond(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean + self.offset)

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean - self.offset)
