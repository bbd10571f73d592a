"""The sensor: irradiance to a signal, step by step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sci_lightning.virtual_camera.hardware.effect import Effect


@dataclass(frozen=True)
class Readout:
    """What the sensor's steps know about the captures that pass.

    Attributes:
        full_scale: the largest DN.
        time: (N,) each capture's exposure.
        random: where noise comes from; None: no noise.
        deviations: without noise, how many standard deviations of its shot noise every pixel is off.
    """

    full_scale: int
    time: np.ndarray
    random: np.random.Generator | None = None
    deviations: float = 0.0


@dataclass(frozen=True)
class SensorEffect(Effect):
    """One step of the sensor."""

    stage: ClassVar[str] = "sensor"

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        """The signal (N, H, W) after this step, 1 at full scale."""
        return signal
