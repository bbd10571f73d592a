"""The modulator's own grid of mirrors: where the mirrors nominally lie in the sensor's field."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from sci_lightning.configuration.bounds import Size
from sci_lightning.homography import check_homography

LEAST_PARTS, MOST_PARTS = 3, 12
"""Fewest and most parts along either axis of a pixel whose footprint is turned against the mirrors."""
UPRIGHT = 0.002
"""Mirrors by which a pixel's edges may lean without being divided: a diagnosis of 34 captures sees 0.02."""
PARTS_A_MIRROR = 16
"""Parts along either axis for every mirror by which a pixel's edges lean: as many as it takes for the image of a random
binary pattern to be right to 0.001 of its contrast, as a root mean square (tests/encoder/test_modulator_grid.py)."""


class ModulatorGrid:
    """Mirrors of another pitch than the pixels, turned or perspective, of which the field may see a part.

    Args:
        sensor_to_modulator: nominal homography, 3 x 3: homogeneous (x, y, 1) of a pixel's centre to (u, v, 1) in
            mirrors, both from 0 at the first centre.
        field: (H, W) in pixels.
        mirrors: (Hm, Wm).

    Raises:
        BadInput: the homography is singular, maps the field off the modulator, or the mirrors cover too little of it.
    """

    def __init__(self, sensor_to_modulator: Sequence[Sequence[float]] | np.ndarray, field: Size, mirrors: Size) -> None:
        self.field, self.mirrors = (field[0], field[1]), (mirrors[0], mirrors[1])
        try:
            matrix = np.array(sensor_to_modulator, np.float64)
        except (TypeError, ValueError):
            matrix = np.full((3, 3), np.nan)
        check_homography(matrix, self.field, self.mirrors)
        centre = ((self.field[1] - 1) / 2, (self.field[0] - 1) / 2, 1.0)
        self.sensor_to_modulator = matrix
        self._matrix: list[list[float]] = (matrix / (matrix[2] @ centre)).tolist()  # the depth is 1 in the centre

    def window(self, rows: slice, columns: slice) -> ModulatorGrid:
        """Return the same mirrors in a part of the field; a slice may have no step."""
        (top, bottom, _), (left, right, _) = (
            part.indices(side) for part, side in zip((rows, columns), self.field, strict=True)
        )
        moved = self.sensor_to_modulator @ np.array([[1, 0, left], [0, 1, top], [0, 0, 1.0]])
        return ModulatorGrid(moved, (bottom - top, right - left), self.mirrors)

    @property
    def upright(self) -> bool:
        """Whether rows and columns of mirrors are rows and columns of pixels, at a constant pitch."""
        (_, b, _), (c, _, _), (d, e, _) = self._matrix
        return not any((b, c, d, e))

    @property
    def parts(self) -> int:
        """Parts along either axis into which a pixel is divided, so that their footprints may be taken as upright."""
        half = (self.field[0] / 2, self.field[1] / 2)
        leaning = 0.0
        for y, x in ((0.0, 0.0), *((down * half[0], across * half[1]) for down in (-1, 1) for across in (-1, 1))):
            points = torch.tensor([y, y + 1, y]).double(), torch.tensor([x, x, x + 1]).double()
            for along in self.mirror_at(*points):
                leaning = max(leaning, min(abs(float(along[1] - along[0])), abs(float(along[2] - along[0]))))
        return 1 if leaning < UPRIGHT else min(max(LEAST_PARTS, math.ceil(PARTS_A_MIRROR * leaning)), MOST_PARTS)

    @property
    def leaning(self) -> float:
        """How much rows and columns of pixels lean against those of mirrors in the field's centre: 0 upright, 1 at 45
        degrees."""
        points = torch.tensor([0.0, 0.5, -0.5, 0.0, 0.0]).double(), torch.tensor([0.0, 0.0, 0.0, 0.5, -0.5]).double()
        ratios = []
        for along in self.mirror_at(*points):
            down, across = abs(float(along[1] - along[2])), abs(float(along[3] - along[4]))
            ratios.append(min(down, across) / max(down, across, 1e-12))
        return max(ratios)

    def mirror_at(self, y: torch.Tensor, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (row, column) in mirrors, from 0 at the first centre, nominally seen at (y, x).

        Args:
            y, x: in pixels from the centre of the field.
        """
        y, x = y + (self.field[0] - 1) / 2, x + (self.field[1] - 1) / 2
        across, down, away = (a * x + b * y + c for a, b, c in self._matrix)
        depth = away.clamp(min=0.1) if isinstance(away, torch.Tensor) else away
        return down / depth, across / depth

    def axes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return mirrors per pixel and the mirror at the field's centre, down and across, of an upright grid."""
        (across, _, left), (_, down, top), _ = self._matrix
        (height, width) = self.field
        return (down, top + down * (height - 1) / 2), (across, left + across * (width - 1) / 2)
