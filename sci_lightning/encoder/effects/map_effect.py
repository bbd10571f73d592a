"""Effects with a map that belongs to one camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from sci_lightning.configuration.bounds import Seed, Size
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array


class ChartEffect(Effect):
    """An effect that is different in every pixel, column or row, and the same in every capture.

    Args:
        size: (H, W) of the field; None for a map of nothing, to be filled later.
        file: .npy of the map, ``(H, W)``, ``(1, W)`` or ``(H, 1)``; None draws one.
        seed: of the drawn map.
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
            chart = torch.from_numpy(read_array(file, prefer="map", dimensions=2).astype("float32"))
            if size is not None and chart.shape != shape:
                raise BadInput(f"{file}: the map of {self.name} is {tuple(chart.shape)}, this run needs {tuple(shape)}")
        elif size is not None:
            chart = self.draw(shape, torch.Generator().manual_seed(seed))
        else:
            chart = torch.zeros(shape)
        self.register_buffer("map", chart)

    @classmethod
    def shape(cls, size: tuple[int, int]) -> tuple[int, int]:
        """Of the map on a field of ``size``."""
        return (1 if cls.chart == "column" else size[0], 1 if cls.chart == "row" else size[1])

    def draw(self, size: tuple[int, int], random: torch.Generator) -> torch.Tensor:
        """A map by chance, of mean 0 and standard deviation 1."""
        numbers = torch.randn(size, generator=random)
        return (numbers - numbers.mean()) / numbers.std().clamp(min=1e-6)
