"""From photons to DN: shot noise, read noise and the converter, which an ideal camera has as its datasheet says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.random_numbers import stream

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class ShotNoise(SensorEffect):
    """The number of electrons is Poisson distributed, with ``full_well`` of them on average at full scale.

    The neutral value is the full well that the session's datasheet states; a hidden effect has another one.
    """

    name = "shot_noise"
    full_well: float = parameter("electrons", 1, 1e9)

    @classmethod
    def neutral(cls, session: Session) -> ShotNoise:
        return cls(session.full_well_e)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> ShotNoise:
        return cls(session.full_well_e * float(random.uniform(2, 4) ** random.choice((-1, 1))))

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return session.states_true_noise  # otherwise there is no stated noise to deviate from

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        electrons = signal * self.full_well
        if readout.random is None:
            return np.maximum(electrons + readout.shot_noise_sigmas * np.sqrt(electrons), 0) / self.full_well
        return readout.random.poisson(electrons) / self.full_well


@dataclass(frozen=True)
class ReadNoise(SensorEffect):
    """Gaussian noise of the amplifier with standard deviation ``std`` in DN, before the converter rounds.

    The neutral value is the read noise that the session's datasheet states; a hidden effect has another one.
    """

    name = "read_noise"
    std: float = parameter("DN", 0, 10000)

    @classmethod
    def neutral(cls, session: Session) -> ReadNoise:
        return cls(session.read_noise_dn)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> ReadNoise:
        return cls(max(session.read_noise_dn, 0.5) * float(random.uniform(1.5, 3)))

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return session.states_true_noise

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        if readout.random is None:
            return signal
        return signal + readout.random.normal(0, self.std / readout.full_scale, signal.shape)


@dataclass(frozen=True)
class ConverterStep(SensorEffect):
    """The converter's most significant bit weighs too much: from half scale upwards it reads ``step`` too high.

    ``step`` is a fraction of full scale. Outside the vocabulary.
    """

    name = "converter_step"
    step: float = parameter("full scale", -0.5, 0.5, (0.01, 0.04), neutral=0.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal + self.step * (signal >= 0.5)


@dataclass(frozen=True)
class DifferentialNonlinearity(SensorEffect):
    """The converter's bits do not weigh what they should, so that some codes are wide and others narrow or missing.

    Bit b weighs 2**b (1 + error), with Gaussian errors of standard deviation ``mismatch``, as in a converter made of
    capacitors; code k is written for signals from the weight of its bits up. ``course`` is the seed of the errors.
    Outside the vocabulary.
    """

    name = "differential_nonlinearity"
    mismatch: float = parameter("1", 0, 0.2, (0.004, 0.02), neutral=0.0)
    course: int = parameter("", 0, 2**31 - 1, (0, 2**31 - 1), neutral=0, integer=True)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        if not self.mismatch:
            return signal
        bits = (readout.full_scale + 1).bit_length() - 1
        weights = 2.0 ** np.arange(bits) * (1 + self.mismatch * stream(self.course, "bits").standard_normal(bits))
        codes = np.arange(1, readout.full_scale + 1)
        weighed = ((codes[:, None] >> np.arange(bits)) & 1) @ weights
        begins = np.maximum.accumulate(weighed * (readout.full_scale / weighed[-1]) - 0.5)
        return np.searchsorted(begins, signal * readout.full_scale, side="right") / readout.full_scale


@dataclass(frozen=True)
class BitDepth(SensorEffect):
    """The converter has only ``bits`` effective bits: 2**bits codes from 0 to full scale, written as the nearest DN.

    The neutral value is the session's bit depth. The converter always clips to [0, full scale].
    """

    name = "bit_depth"
    bits: int = parameter("bits", 1, 16, integer=True)

    @classmethod
    def neutral(cls, session: Session) -> BitDepth:
        return cls(session.bit_depth)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> BitDepth:
        return cls(session.bit_depth - int(random.integers(1, 3, endpoint=True)))

    def check(self, session: Session) -> None:
        if self.bits > session.bit_depth:
            raise BadInput(f"bit_depth.bits must be at most the file's bit depth {session.bit_depth}, got {self.bits}")

    def quantise(self, signal: np.ndarray, full_scale: int) -> np.ndarray:
        """Return the raw DN, whole numbers from 0 to ``full_scale``, of a signal that is 1 at full scale."""
        codes = 2**self.bits - 1
        code = np.floor(np.clip(signal, 0, 1) * codes + 0.5)
        return np.floor(code * full_scale / codes + 0.5)

    def interval(self, dn: np.ndarray, full_scale: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the signals that this converter writes as ``dn``, infinite at both ends of the range."""
        codes = 2**self.bits - 1
        code = np.round(dn * (codes / full_scale))
        low = np.where(code == 0, -np.inf, (code - 0.5) / codes)
        return low, np.where(code == codes, np.inf, (code + 0.5) / codes)
