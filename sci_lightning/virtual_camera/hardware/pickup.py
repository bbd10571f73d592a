"""Electrical pickup: offsets that the pixels of a row share and the captures do not. All outside the vocabulary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect


@dataclass(frozen=True)
class RowFlutter(SensorEffect):
    """The supply flutters: every row of every capture has a zero of its own, Gaussian of ``std`` (of full scale)."""

    name = "row_flutter"
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        if readout.random is None or not self.std:
            return signal
        return signal + readout.random.normal(0, self.std, (*signal.shape[:2], 1))


@dataclass(frozen=True)
class Banding(SensorEffect):
    """Hum of the mains: a sine over the rows, as far on in every next capture as ``advance`` (turns) says."""

    name = "banding"
    amplitude: float = parameter("full scale", 0, 1, (0.005, 0.025), neutral=0.0)
    period: float = parameter("pixel", 2, 65536, (7, 30), neutral=16.0, magnitude=False)
    advance: float = parameter("turns", 0, 1, (0.1, 0.9), neutral=0.0, magnitude=False)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        number, row = np.ogrid[: signal.shape[0], : signal.shape[1]]
        wave = np.sin(2 * np.pi * (row / self.period + number * self.advance))
        return signal + self.amplitude * wave[:, :, None]
