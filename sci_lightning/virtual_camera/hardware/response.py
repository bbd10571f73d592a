"""The sensor's response: the same for every pixel and every time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect


@dataclass(frozen=True)
class Gain(SensorEffect):
    """More or fewer of the photons are caught: light * factor, before the photons are counted."""

    name = "gain"
    factor: float = parameter("1", 0.01, 100, (0.04, 0.2), neutral=1.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return signal * self.factor


@dataclass(frozen=True)
class Saturation(SensorEffect):
    """The wells are full at ``level`` (of full scale): electrons beyond, counted with their noise, are lost."""

    name = "saturation"
    level: float = parameter("full scale", 0, 1, (0.08, 0.4), neutral=1.0)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return np.minimum(signal, self.level)


@dataclass(frozen=True)
class ResponseGamma(SensorEffect):
    """A power law, after the wells: out = in ** gamma."""

    name = "response_gamma"
    gamma: float = parameter("1", 0.1, 10, (0.05, 0.3), neutral=1.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return signal**self.gamma


@dataclass(frozen=True)
class SShapedResponse(SensorEffect):
    """Slow in the dark, fast between, slow in the light: in - strength sin(2 pi in) / 2 pi. Outside the vocabulary."""

    name = "s_shaped_response"
    strength: float = parameter("1", 0, 1, (0.15, 0.6), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return signal - self.strength * np.sin(2 * np.pi * np.clip(signal, 0, 1)) / (2 * np.pi)


@dataclass(frozen=True)
class BlackLevel(SensorEffect):
    """The amplifier's zero is off by ``offset`` (of full scale), whatever the exposure; negative ones clip the dark."""

    name = "black_level"
    offset: float = parameter("full scale", -1, 1, (0.01, 0.06), neutral=0.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return signal + self.offset
