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
    """What a pixel makes of light, the same for every pixel; everything is interpolated between tabulated levels.

    The likelihood is differentiated twice by differences: a jump between two levels, or a rounding in single
    precision, would be taken for curvature.

    Attributes:
        levels: ``(L,)`` light, 1 being full scale.
        recorded: ``(L,)`` expected signal.
        slope: ``(L - 1,)`` between the levels.
        log_slope: ``(L,)`` logarithm of the slope at the levels.
        variance: ``(L,)`` of the noise, the converter's rounding included, in units of the light squared.
    """

    levels: torch.Tensor
    recorded: torch.Tensor
    slope: torch.Tensor
    log_slope: torch.Tensor
    variance: torch.Tensor

    @staticmethod
    def of(path: LightPath, full_scale: int) -> SensorResponse:
        """Tabulate the response of a light path's sensor with a converter of ``full_scale`` steps."""
        levels = torch.linspace(DARKEST, BRIGHTEST, LEVELS, dtype=torch.float64)
        none, ones = torch.zeros((), dtype=torch.float64), torch.ones(1, 1, 1, dtype=torch.float64)
        even = Signal(levels[:, None, None], none, ones, 1 / full_scale, (0, 0), (1, 1))
        signal = LightPath(path.of(SensorEffect)).respond(even)
        recorded = signal.mean.flatten().double()
        variance = signal.variance.expand_as(signal.mean).flatten().double() + 1 / 12 / full_scale**2
        slope = (recorded.diff() / levels.diff()).clamp(min=LEAST_SLOPE)
        log_slope = torch.cat([slope[:1], (slope[1:] * slope[:-1]).sqrt(), slope[-1:]]).log()
        return SensorResponse(levels, recorded, slope, log_slope, variance / (2 * log_slope).exp())

    @property
    def without_light(self) -> float:
        """What is recorded without any light, over the slope there: the light that a straight response takes it for."""
        place = int(torch.searchsorted(self.levels, 0.0)) - 1
        return float(self.recorded[place] / self.slope[place] - self.levels[place])

    def light(self, signal: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the light that is recorded as ``signal`` (..), and the logarithm of the response's slope there."""
        place = torch.searchsorted(self.recorded, signal.contiguous()).clamp(1, LEVELS - 1) - 1
        beyond = (signal - self.recorded[place]) / self.slope[place]
        light = self.levels[place] + beyond
        return light, self._between(self.log_slope, light)

    def noise(self, light: torch.Tensor) -> torch.Tensor:
        """Return the variance (..) of the noise at a light (..), in units of the light squared."""
        return self._between(self.variance, light)

    def _between(self, values: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
        """Return tabulated ``values`` (L,) at a light (..), linear between the levels and constant beyond them."""
        place = ((light - DARKEST) / (BRIGHTEST - DARKEST) * (LEVELS - 1)).clamp(0, LEVELS - 1)
        lower = place.long().clamp(max=LEVELS - 2)
        return torch.lerp(values[lower], values[lower + 1], place - lower)
