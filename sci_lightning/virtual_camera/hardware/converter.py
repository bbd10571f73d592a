"""From photons to numbers: what every camera does, and an ideal one does as its datasheet says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class ShotNoise(SensorEffect):
    """Photons come one by one: a Poisson number of electrons, ``full_well`` of them at full scale on average.

    Neutral is the session's (the datasheet's) full well; hidden, it is another.
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
    def suits(cls, session: Session) -> bool:
        return session.datasheet  # noise that no datasheet states deviates from nothing

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        electrons = signal * self.full_well
        if readout.random is None:
            return np.maximum(electrons + readout.deviations * np.sqrt(electrons), 0) / self.full_well
        return readout.random.poisson(electrons) / self.full_well


@dataclass(frozen=True)
class ReadNoise(SensorEffect):
    """Gaussian noise of the amplifier, ``std`` in DN, before the converter rounds.

    Neutral is the session's (the datasheet's) read noise; hidden, it is another.
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
    def suits(cls, session: Session) -> bool:
        return session.datasheet

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        if readout.random is None:
            return signal
        return signal + readout.random.normal(0, self.std / readout.full_scale, signal.shape)


@dataclass(frozen=True)
class ConverterStep(SensorEffect):
    """The converter's largest weight is off: everything from half scale upwards reads ``step`` (of full scale) higher.

    Outside the vocabulary.
    """

    name = "converter_step"
    step: float = parameter("full scale", -0.5, 0.5, (0.01, 0.04), neutral=0.0, signed=True)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        return signal + self.step * (signal >= 0.5)


@dataclass(frozen=True)
class BitDepth(SensorEffect):
    """The converter has ``bits`` only: 2**bits codes, evenly from 0 to full scale, each written as the nearest DN.

    Neutral is the session's bit depth. It clips to [0, full scale], always.
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

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        codes = 2**self.bits - 1
        code = np.floor(np.clip(signal, 0, 1) * codes + 0.5)
        return np.floor(code * readout.full_scale / codes + 0.5) / readout.full_scale

    def interval(self, dn: np.ndarray, full_scale: int) -> tuple[np.ndarray, np.ndarray]:
        """The signals that this converter writes as ``dn``: from, to (infinite at the ends)."""
        codes = 2**self.bits - 1
        code = np.round(dn * (codes / full_scale))
        low = np.where(code == 0, -np.inf, (code - 0.5) / codes)
        return low, np.where(code == codes, np.inf, (code + 0.5) / codes)
