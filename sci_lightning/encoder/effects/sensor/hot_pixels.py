"""Hot pixels: a few pixels collect charge without light."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.map_effect import MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal


class HotPixels(MapEffect, SensorEffect):
    """Some pixels have an excess that grows with the integration time and not with the light.

    Args:
        fraction: the part of the pixels that is hot, 0 to 1. At 0 the map has no effect.
        size, file, seed: see :class:`MapEffect`; in a drawn map the excess is 0.05 to 0.6 of full scale.
    """

    name = "hot_pixels"
    rank = 58
    about = {"fraction": Parameter("1", 0.0, 0, 1, step=0.001, starts=(0.002,))}
    sentence = "{fraction} of the pixels are hot"
    map_kind = "hot"
    map_unit = "full scale"

    def draw(self, size: tuple[int, ...], random: torch.Generator) -> torch.Tensor:
        excess = 0.05 + 0.55 * torch.rand(size, generator=random)
        return excess * (torch.rand(size, generator=random) < self.fraction)

    def respond(self, signal: Signal) -> Signal:
        if float(self.fraction.detach()) == 0:
            return signal
        return signal.with_mean(signal.mean + signal.exposure * signal.window(self.map))

    def undo(self, signal: Signal) -> Signal:
        if float(self.fraction.detach()) == 0:
            return signal
        return signal.with_mean(signal.mean - signal.exposure * signal.window(self.map))
