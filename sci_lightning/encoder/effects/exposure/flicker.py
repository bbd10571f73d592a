"""Flicker: the light source pulsates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.exposure import Exposure

FREQUENCIES = tuple(0.25 + 0.5 * step for step in range(9))
PHASES = (-1.5 * math.pi / 2, -0.5 * math.pi / 2, 0.5 * math.pi / 2, 1.5 * math.pi / 2)


class Flicker(ExposureEffect):
    r"""The source shines as :math:`1 + A \sin(2 \pi f s / T + \varphi)`, s in slots from the exposure's start.

    Every slot collects the integral, so that flicker much faster than a slot averages to nothing.

    Args:
        amplitude: A, 0 to 1. frequency: f, cycles per exposure, 0.05 to 1000. phase: radian, -2 pi to 2 pi.
    """

    name = "flicker"
    rank = 31
    about = {
        "amplitude": Parameter("1", 0.0, 0, 1, step=0.01, starts=(0.1,)),
        "frequency": Parameter("cycles per exposure", None, 0.05, 1000, step=0.02, starts=FREQUENCIES),
        "phase": Parameter("rad", None, -2 * math.pi, 2 * math.pi, step=0.05, starts=PHASES, period=2 * math.pi),
    }
    plainer: ClassVar[str | None] = "gain"  # much slower than an exposure, the light is only stronger or weaker
    sentence = "the light flickers by {amplitude} of its mean, {frequency} times per exposure"
    amplitude: torch.Tensor
    frequency: torch.Tensor
    phase: torch.Tensor

    def expose(self, exposure: Exposure) -> Exposure:
        cycles = self.frequency / exposure.slots
        angle = 2 * math.pi * cycles * exposure.times() + self.phase
        mean = torch.sinc(cycles / exposure.power.shape[1]) * torch.sin(
            angle
        )  # the mean over a step, exact for any frequency
        return replace(exposure, power=exposure.power * (1 + self.amplitude * mean))
