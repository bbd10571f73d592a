"""Fixed patterns of the sensor: what differs from pixel to pixel and stays in every capture.

Random maps are scaled to have exactly the mean and standard deviation that the parameters say: they are this very
camera's, not those of the batch it came from, and their mean is no gain and no black level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.hardware.spots import spots

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class Multiplied(SensorEffect):
    """Every pixel catches its own part of the light: light * chart, before the photons are counted."""

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        assert chart is not None
        return signal * chart


@dataclass(frozen=True)
class Added(SensorEffect):
    """Every column or row has its own zero: signal + chart."""

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        assert chart is not None
        return signal + chart


@dataclass(frozen=True)
class Prnu(Multiplied):
    """Photo response non-uniformity: Gaussian gains of mean 1 and ``std``, a pixel each."""

    name = "prnu"
    gaussian = True
    std: float = parameter("1", 0, 0.3, (0.01, 0.05), neutral=0.0)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return np.maximum(1 + self.std * _standard(random, size), 0)


@dataclass(frozen=True)
class ColumnNoise(Added):
    """A column's amplifier each with its own zero: Gaussian of mean 0 and ``std`` (of full scale)."""

    name = "column_noise"
    gaussian = True
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return self.std * _standard(random, (1, size[1]))


@dataclass(frozen=True)
class RowNoise(Added):
    """A row's reset each with its own zero: Gaussian of mean 0 and ``std`` (of full scale)."""

    name = "row_noise"
    gaussian = True
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return self.std * _standard(random, (size[0], 1))


@dataclass(frozen=True)
class HotPixels(SensorEffect):
    """A ``fraction`` of the pixels (at least one) leaks charge: 0.05 to 0.6 of full scale per nominal exposure."""

    name = "hot_pixels"
    fraction: float = parameter("1", 0, 1, (0.0008, 0.006), neutral=0.0)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        excess = np.zeros(size)
        count = max(round(self.fraction * excess.size), 1) if self.fraction else 0
        where = random.permutation(excess.size)[:count]
        excess.flat[where] = random.uniform(0.05, 0.6, count)
        return excess

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        assert chart is not None
        return signal + readout.time[:, None, None] * chart


@dataclass(frozen=True)
class InterlacedGain(Multiplied):
    """Two amplifiers read odd and even rows: gains 1 +- difference / 2, the more for row 0. Outside the vocabulary."""

    name = "interlaced_gain"
    difference: float = parameter("1", -1, 1, (0.02, 0.1), neutral=0.0, signed=True)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 + self.difference * (0.5 - np.arange(size[0])[:, None] % 2)


@dataclass(frozen=True)
class DeadColumn(Multiplied):
    """One column lost a part ``loss`` of its light, 1 for all of it. Outside the vocabulary."""

    name = "dead_column"
    loss: float = parameter("1", 0, 1, (0.4, 1), neutral=0.0)
    column: int = parameter("pixel", 0, 65535, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> DeadColumn:
        return cls(float(random.uniform(0.4, 1)), int(random.integers(session.size[1])))

    def check(self, session: Session) -> None:
        if self.column >= session.size[1]:
            raise BadInput(f"dead_column.column must be from 0 to {session.size[1] - 1}, got {self.column}")

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 - self.loss * (np.arange(size[1]) == self.column)


@dataclass(frozen=True)
class SensorDust(Multiplied):
    """Grains on the sensor's glass: soft dark spots that stay where they are. Outside the vocabulary."""

    name = "sensor_dust"
    depth: float = parameter("1", 0, 1, (0.2, 0.7), neutral=0.0)
    radius: float = parameter("pixel", 0.5, 64, (1.5, 4), neutral=2.5, magnitude=False)
    count: int = parameter("grains", 0, 1000, (3, 8), neutral=5, integer=True)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 - self.depth * spots(random, size, self.count, self.radius)


def _standard(random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """Gaussian numbers of mean 0 and standard deviation 1 exactly."""
    numbers = random.standard_normal(size)
    return (numbers - numbers.mean()) / numbers.std()
