"""Fixed-pattern effects of the sensor: gains and offsets that differ between pixels and stay the same over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.random_numbers import dust_spots, standard_normal

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class PixelGain(SensorEffect):
    """Every pixel has its own gain: light * map, before the photons are counted."""

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal * readout.fixed_maps[self.name]


@dataclass(frozen=True)
class LineOffset(SensorEffect):
    """Every column or row has its own offset: signal + map."""

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal + readout.fixed_maps[self.name]


@dataclass(frozen=True)
class Prnu(PixelGain):
    """Photo response non-uniformity: Gaussian gains of the pixels with mean 1 and standard deviation ``std``."""

    name = "prnu"
    gaussian_map = True
    std: float = parameter("1", 0, 0.3, (0.01, 0.05), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return np.maximum(1 + self.std * standard_normal(random, size), 0)


@dataclass(frozen=True)
class ColumnNoise(LineOffset):
    """The columns have Gaussian offsets of mean 0 and standard deviation ``std``, a fraction of full scale."""

    name = "column_noise"
    gaussian_map = True
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return self.std * standard_normal(random, (1, size[1]))


@dataclass(frozen=True)
class RowNoise(LineOffset):
    """The rows have Gaussian offsets of mean 0 and standard deviation ``std``, a fraction of full scale."""

    name = "row_noise"
    gaussian_map = True
    std: float = parameter("full scale", 0, 1, (0.004, 0.02), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return self.std * standard_normal(random, (size[0], 1))


@dataclass(frozen=True)
class HotPixels(SensorEffect):
    """A ``fraction`` of the pixels (at least one) adds 0.05 to 0.6 of full scale per nominal exposure, light or not."""

    name = "hot_pixels"
    fraction: float = parameter("1", 0, 1, (0.0008, 0.006), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        excess = np.zeros(size)
        count = max(round(self.fraction * excess.size), 1) if self.fraction else 0
        chosen = random.permutation(excess.size)[:count]
        excess.flat[chosen] = random.uniform(0.05, 0.6, count)
        return excess

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        return signal + readout.exposure[:, None, None] * readout.fixed_maps[self.name]


@dataclass(frozen=True)
class InterlacedGain(PixelGain):
    """Two amplifiers read even and odd rows with gains 1 + difference / 2 and 1 - difference / 2.

    Outside the vocabulary.
    """

    name = "interlaced_gain"
    difference: float = parameter("1", -1, 1, (0.02, 0.1), neutral=0.0, signed=True)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 + self.difference * (0.5 - np.arange(size[0])[:, None] % 2)


@dataclass(frozen=True)
class DeadColumn(PixelGain):
    """One column loses a part ``loss`` of its light, 1 for all of it. Outside the vocabulary."""

    name = "dead_column"
    loss: float = parameter("1", 0, 1, (0.4, 1), neutral=0.0)
    column: int = parameter("pixel", 0, 65535, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> DeadColumn:
        return cls(float(random.uniform(0.4, 1)), int(random.integers(session.size[1])))

    def check(self, session: Session) -> None:
        if self.column >= session.size[1]:
            raise BadInput(f"dead_column.column must be from 0 to {session.size[1] - 1}, got {self.column}")

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 - self.loss * (np.arange(size[1]) == self.column)


@dataclass(frozen=True)
class SensorDust(PixelGain):
    """Grains on the sensor's cover glass: soft dark spots that do not move. Outside the vocabulary."""

    name = "sensor_dust"
    depth: float = parameter("1", 0, 1, (0.2, 0.7), neutral=0.0)
    radius: float = parameter("pixel", 0.5, 64, (1.5, 4), neutral=2.5, magnitude=False)
    count: int = parameter("grains", 0, 1000, (3, 8), neutral=5, integer=True)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        return 1 - self.depth * dust_spots(random, size, self.count, self.radius)
