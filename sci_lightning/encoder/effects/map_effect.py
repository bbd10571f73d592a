"""Effects with a fixed-pattern map: different from place to place, the same in every capture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from sci_lightning.configuration.bounds import Seed, Size
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array


class MapEffect(Effect):
    """An effect with a map that belongs to one camera; a subclass also derives from the base class of its stage.

    Args:
        size: (H, W) of the field; None for a map of zeros, to be filled later.
        file: .npy of the map, ``(H, W)``, ``(1, W)`` or ``(H, 1)``; None draws one.
        seed: seed of the drawn map.
        values: parameters by name.

    Raises:
        BadInput: the file cannot be read or does not fit the size.
    """

    map: torch.Tensor
    std: torch.Tensor
    fraction: torch.Tensor

    def __init__(self, size: Size | None = None, file: str | Path | None = None, seed: Seed = 0, **values: Any) -> None:
        super().__init__(**values)
        shape = (1, 1) if size is None else self.shape((size[0], size[1]))
        if file is not None:
            values_of_map = torch.from_numpy(read_array(file, prefer="map", dimensions=2).astype("float32"))
            if size is not None and values_of_map.shape != shape:
                raise BadInput(
                    f"{file}: the map of {self.name} is {tuple(values_of_map.shape)}, this run needs {tuple(shape)}"
                )
        elif size is not None:
            values_of_map = self.draw(shape, torch.Generator().manual_seed(seed))
        else:
            values_of_map = torch.zeros(shape)
        self.register_buffer("map", values_of_map)

    @classmethod
    def shape(cls, size: tuple[int, int]) -> tuple[int, ...]:
        """Return the shape of the map on a field of ``size``."""
        return (1 if cls.map_kind == "column" else size[0], 1 if cls.map_kind == "row" else size[1])

    def draw(self, size: tuple[int, ...], random: torch.Generator) -> torch.Tensor:
        """Draw a random map of mean 0 and standard deviation 1."""
        numbers = torch.randn(size, generator=random)
        return (numbers - numbers.mean()) / numbers.std().clamp(min=1e-6)


class FixedPatternOffset(MapEffect, SensorEffect):
    r"""Offsets that are the same in every capture: :math:`m + s\, c`, with a map c of mean 0 and standard deviation 1.

    A subclass says in ``map_kind`` whether pixels, columns or rows have an offset of their own.

    Args:
        std: s, standard deviation of the offsets, fraction of full scale, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    def respond(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean + self.std * signal.window(self.map))

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean - self.std * signal.window(self.map))


class FixedPatternGain(MapEffect, SensorEffect):
    r"""Gains that are the same in every capture: :math:`m\,(1 + s\, c)`, with c of mean 0 and standard deviation 1.

    The variance grows by the square. A subclass says in ``map_kind`` whether pixels, columns or rows have a gain.

    Args:
        std: s, standard deviation of the gains, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    def respond(self, signal: Signal) -> Signal:
        gain = self._gain(signal)
        return signal.with_moments(signal.mean * gain, signal.variance * gain.square())

    def undo(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean / self._gain(signal).clamp(min=0.05))  # a dead pixel stays dark

    def _gain(self, signal: Signal) -> torch.Tensor:
        return 1 + self.std * signal.window(self.map)
