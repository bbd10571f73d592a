"""The sensor: from irradiance to the signal that reaches the converter. Effects that every pixel has alike.

Effects that differ from pixel to pixel are in :mod:`.fixed_pattern`; noise and the converter in :mod:`.converter`. The
last two, charge and voltage that cross from pixel to pixel, are known from CCDs and infrared arrays and outside the
vocabulary.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sci_lightning.virtual_camera.hardware.effect import Effect, parameter


@dataclass(frozen=True)
class Readout:
    """What the steps of the sensor know about the captures that are read out.

    Attributes:
        full_scale: the largest DN.
        exposure: (N,) integration time of every capture relative to nominal.
        fixed_maps: the camera's own maps by the name of their effect.
        random: source of the noise; None for a signal without noise.
        shot_noise_sigmas: without a source of noise, how many standard deviations of its shot noise are added to every
            pixel.
    """

    full_scale: int
    exposure: np.ndarray
    fixed_maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    random: np.random.Generator | None = None
    shot_noise_sigmas: float = 0.0


@dataclass(frozen=True)
class SensorEffect(Effect):
    """One step of the sensor."""

    stage: ClassVar[str] = "sensor"

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        """Return the signal (N, H, W) after this step, 1 at full scale."""
        return signal


@dataclass(frozen=True)
class ImageLag(SensorEffect):
    """Pixels are not emptied completely: a ``fraction`` of every capture is in the next one. Outside the vocabulary.

    Captures follow each other in the order of their numbers; nothing precedes the first.
    """

    name = "image_lag"
    fraction: float = parameter("1", 0, 0.5, (0.01, 0.05), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        before = np.concatenate((np.zeros_like(signal[:1]), signal[:-1]))
        return signal + self.fraction * before


@dataclass(frozen=True)
class Gain(SensorEffect):
    """More or fewer of the photons are detected: light * factor, before the photons are counted."""

    name = "gain"
    factor: float = parameter("1", 0.01, 100, (0.04, 0.2), neutral=1.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal * self.factor


@dataclass(frozen=True)
class Saturation(SensorEffect):
    """The wells are full at ``level``, a fraction of full scale; electrons beyond it are lost, noise included."""

    name = "saturation"
    level: float = parameter("full scale", 0, 1, (0.08, 0.4), neutral=1.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return np.minimum(signal, self.level)


@dataclass(frozen=True)
class ResponseGamma(SensorEffect):
    """A power law after the wells: out = in ** gamma, odd about 0, below which pixels' offsets may lead."""

    name = "response_gamma"
    gamma: float = parameter("1", 0.1, 10, (0.05, 0.3), neutral=1.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return np.sign(signal) * np.abs(signal) ** self.gamma


@dataclass(frozen=True)
class SShapedResponse(SensorEffect):
    """The response is flat at both ends and steep between: in - strength sin(2 pi in) / 2 pi.

    Outside the vocabulary.
    """

    name = "s_shaped_response"
    strength: float = parameter("1", 0, 1, (0.15, 0.6), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal - self.strength * np.sin(2 * np.pi * np.clip(signal, 0, 1)) / (2 * np.pi)


@dataclass(frozen=True)
class BlackLevel(SensorEffect):
    """The amplifier adds ``offset``, a fraction of full scale, at any exposure; a negative one clips the dark."""

    name = "black_level"
    offset: float = parameter("full scale", -1, 1, (0.01, 0.06), neutral=0.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal + self.offset


@dataclass(frozen=True)
class RowFlutter(SensorEffect):
    """The supply voltage flutters: every row of every capture has its own random offset. Outside the vocabulary.

    The offsets are Gaussian with standard deviation ``std``, a fraction of full scale.
    """

    name = "row_flutter"
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        if readout.random is None or not self.std:
            return signal
        return signal + readout.random.normal(0, self.std, (*signal.shape[:2], 1))


@dataclass(frozen=True)
class Banding(SensorEffect):
    """Hum of the mains: a sine over the rows that advances by ``advance`` turns per capture. Outside the vocabulary."""

    name = "banding"
    amplitude: float = parameter("full scale", 0, 1, (0.005, 0.025), neutral=0.0)
    period: float = parameter("pixel", 2, 65536, (7, 30), neutral=16.0, magnitude=False)
    advance: float = parameter("turns", 0, 1, (0.1, 0.9), neutral=0.0, magnitude=False)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        number, row = np.ogrid[: signal.shape[0], : signal.shape[1]]
        wave = np.sin(2 * np.pi * (row / self.period + number * self.advance))
        return signal + self.amplitude * wave[:, :, None]


@dataclass(frozen=True)
class BrighterFatter(SensorEffect):
    """Charge that has gathered repels what arrives, so that bright spots are wider than faint ones.

    Between two neighbours with charges p and q flows ``strength`` (p + q)/2 (p - q), from the fuller to the emptier;
    charges are fractions of full scale. After Antilogus et al., "The brighter-fatter effect and pixel correlations in
    CCD sensors", JINST 9 (2014): the border between pixels moves in proportion to their charge.
    """

    name = "brighter_fatter"
    strength: float = parameter("1", 0, 0.25, (0.02, 0.08), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        changed = signal.copy()
        for axis in (1, 2):
            changed += _inflow(self.strength * signal**2 / 2, axis)
        return np.maximum(changed, 0)  # more than there is cannot flow away, however bright the neighbours


@dataclass(frozen=True)
class InterPixelCapacitance(SensorEffect):
    """Each pixel's voltage couples a part ``coupling`` into each of its four neighbours, its noise included.

    After Moore, Ninkov and Forrest, "Quantum efficiency overestimation and deterministic cross talk resulting from
    interpixel capacitance", Optical Engineering 45 (2006).
    """

    name = "inter_pixel_capacitance"
    coupling: float = parameter("1", 0, 0.2, (0.008, 0.03), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        changed = signal.copy()
        for axis in (1, 2):
            changed += _inflow(self.coupling * signal, axis)
        return changed


def _inflow(potential: np.ndarray, axis: int) -> np.ndarray:
    """Return what every pixel receives from its two neighbours along an axis: the sum of the differences to it."""
    flow = np.diff(potential, axis=axis)  # nothing crosses the border of the field
    return np.diff(flow, axis=axis, prepend=0, append=0)
