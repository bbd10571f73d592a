"""The sensor's response as a table, and its inverse: from recorded values to light."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.encoder.effects import SensorEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal

LEVELS = 1025
"""Levels of light at which the response is tabulated."""
DARKEST, BRIGHTEST = -0.1, 2.0
"""The smallest and the largest of them, 1 being full scale."""
LEAST_SLOPE = 1e-6
"""Slope of a response that ends: its inverse does not exist there."""


@dataclass(frozen=True)
class SensorResponse:
    """What a pixel makes of light, the same for every pixel, linear between tabulated levels.

    Attributes:
        levels: ``(L,)`` light, 1 being full scale.
        recorded: ``(L,)`` expected signal.
        variance: ``(L,)`` of the signal, the converter's rounding included.
        slope: ``(L - 1,)`` between the levels.
    """

    levels: torch.Tensor
    recorded: torch.Tensor
    variance: torch.Tensor
    slope: torch.Tensor

    @staticmethod
    def of(path: LightPath, full_scale: int) -> SensorResponse:
        """Tabulate the response of a light path's sensor with a converter of ``full_scale`` steps."""
        levels = torch.linspace(DARKEST, BRIGHTEST, LEVELS)
        ones = torch.ones(1, 1, 1)
        even = Signal(levels[:, None, None], torch.zeros(()), ones, 1 / full_scale, (0, 0), (1, 1))
        signal = LightPath(path.of(SensorEffect)).respond(even)
        recorded = signal.mean.flatten().double()
        variance = signal.variance.expand_as(signal.mean).flatten().double() + 1 / 12 / full_scale**2
        slope = (recorded.diff() / levels.double().diff()).clamp(min=LEAST_SLOPE)
        return SensorResponse(levels.double(), recorded, variance, slope)

    def light(self, signal: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the light that is recorded as ``signal`` (..), and the logarithm of the response's slope there."""
        place = torch.searchsorted(self.recorded, signal.contiguous()).clamp(1, LEVELS - 1) - 1
        slope = self.slope[place]
        return self.levels[place] + (signal - self.recorded[place]) / slope, slope.log()

    def noise(self, light: torch.Tensor) -> torch.Tensor:
        """Return the variance (..) of the noise at a light (..), in units of the light squared."""
        place = ((light - DARKEST) / (BRIGHTEST - DARKEST) * (LEVELS - 1)).long().clamp(0, LEVELS - 2)
        return self.variance[place] / self.slope[place].square()
