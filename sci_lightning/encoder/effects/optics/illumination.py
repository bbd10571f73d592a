"""Illumination: the light is uneven, smoothly over the field."""

from __future__ import annotations

import math

import torch

from sci_lightning.encoder.effects.map_effect import MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.signal import Signal

FINEST = 4
"""Half periods across the field, at most, in a map that is drawn."""


class Illumination(MapEffect, OpticsEffect):
    r"""Light times :math:`1 + s\, c`, with a smooth map c of mean 0 and standard deviation 1.

    The map has no detail much finer than an eighth of the field: a source beside the axis, a lamp with several bulbs, a
    condenser out of place. What falls off with the radius alone is ``vignetting``, what differs from pixel to pixel
    ``prnu``.

    Args:
        std: s, standard deviation of the light over the field, 0 to 1.
        size, file, seed: see :class:`MapEffect`; a drawn map is a sum of cosines of at most 4 half periods.
    """

    name = "illumination"
    rank = 41.5
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.02,))}
    sentence = "the light is uneven, smoothly over the field, by {std} (standard deviation)"
    map_kind = "smooth"

    def draw(self, size: tuple[int, ...], random: torch.Generator) -> torch.Tensor:
        down, across = (
            torch.cos(math.pi * torch.arange(FINEST + 1)[:, None] * (torch.arange(length) + 0.5) / length)
            for length in size
        )
        frequency = torch.arange(FINEST + 1).square()
        factors = torch.randn(FINEST + 1, FINEST + 1, generator=random) / (1 + frequency[:, None] + frequency)
        field = torch.einsum("ij,ih,jw->hw", factors, down, across)
        return (field - field.mean()) / field.std().clamp(min=1e-6)

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean * self._light(signal))

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean / self._light(signal).clamp(min=0.05))  # a dark corner stays dark

    def _light(self, signal: Signal) -> torch.Tensor:
        return 1 + self.std * signal.window(self.map)
