"""The values of all fixed-pattern maps at once: the information about them, and its inverse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap

DENSE = ("row", "column", "smooth")
"""Kinds of maps with few values, each of which many pixels share."""
RIDGE_SHARE = 1e-10
"""Part of the largest entry that is added to the diagonal first, where rounding leaves no Cholesky factor."""


class MapSystem:
    """The information about the values of all maps, and its inverse.

    Maps of pixels are eliminated one after the other, pixel by pixel; what remains couples rows, columns and smooth
    functions and is small and dense. The values of all maps stand in one vector, map after map, S in all.

    Args:
        maps: any number.
        information: ``(N, H, W)`` about the mean of every fitted pixel, 0 for held-out ones.
    """

    def __init__(self, maps: Sequence[FixedPatternMap], information: torch.Tensor) -> None:
        self.maps = sorted(maps, key=lambda one: one.kind in DENSE)
        self._pixels = [i for i, one in enumerate(self.maps) if one.kind not in DENSE]
        self._lines = [i for i, one in enumerate(self.maps) if one.kind in DENSE]
        indices = range(len(self.maps))
        self._shared = {
            (i, j): (self.maps[i].jacobian * self.maps[j].jacobian * information).sum(0).double()
            for i in indices
            for j in indices[i + 1 :]
        }
        self._inverse: list[torch.Tensor] = []
        own = {i: self.maps[i].precision for i in self._pixels}
        lost = {j: torch.zeros(information.shape[1:], dtype=torch.float64) for j in self._lines}
        for i in self._pixels:
            inverse = torch.where(self.maps[i].active, 1 / own[i], 0.0)
            self._inverse.append(inverse)
            later = indices[i + 1 :]
            for j in later:
                taken = self._shared[i, j] * inverse
                if j in own:
                    own[j] = own[j] - taken * self._shared[i, j]
                else:
                    lost[j] = lost[j] + taken * self._shared[i, j]
                for k in indices[j + 1 :]:
                    self._shared[j, k] = self._shared[j, k] - taken * self._shared[i, k]
        self._dense = self._line_matrix(lost)

    def _line_matrix(self, lost: Mapping[int, torch.Tensor]) -> torch.Tensor:
        """Return the Cholesky factor of the information about all rows, columns and smooth functions."""
        blocks = []
        for i in self._lines:
            across = []
            for j in self._lines:
                if i == j:
                    across.append(self.maps[i].line_information(lost[i]))
                    continue
                shared = self._shared[min(i, j), max(i, j)]
                across.append(self.maps[i].shared_information(self.maps[j], shared))
            blocks.append(torch.cat(across, 1))
        return _cholesky(torch.cat(blocks)) if blocks else torch.zeros(0, 0)

    @property
    def gradient(self) -> torch.Tensor:
        """``(S,)`` gradient of the penalised log-likelihood with respect to every value."""
        return torch.cat([one.gradient.flatten() for one in self.maps]) if self.maps else torch.zeros(0).double()

    def cross_information(self, weighted: torch.Tensor) -> torch.Tensor:
        """Return the information that the values share with changes of the mean, ``(K, S)``.

        Args:
            weighted: ``(K, N, H, W)`` changes of the mean times the information about it.
        """
        shared = [one.cross_information(weighted).flatten(1) for one in self.maps]
        return torch.cat(shared, 1) if shared else torch.zeros(len(weighted), 0, dtype=torch.float64)

    def split(self, values: torch.Tensor) -> list[torch.Tensor]:
        """Split ``(K, S)`` into one ``(K, *map)`` for each map."""
        sizes = [one.values.numel() for one in self.maps]
        return [
            part.unflatten(1, one.values.shape) for one, part in zip(self.maps, values.split(sizes, 1), strict=True)
        ]

    def solve(self, right: torch.Tensor) -> torch.Tensor:
        """Return the inverse information times ``(K, S)``."""
        if not self.maps:
            return right
        parts = self.split(right)
        for i, inverse in zip(self._pixels, self._inverse, strict=True):
            for j in range(i + 1, len(parts)):
                parts[j] = parts[j] - self.maps[j].reduce(self._shared[i, j] * inverse * parts[i])
        if self._lines:
            stacked = torch.cat([parts[i].flatten(1) for i in self._lines], 1)
            solved = torch.cholesky_solve(stacked.T, self._dense).T
            sizes = [self.maps[i].values.numel() for i in self._lines]
            for i, part in zip(self._lines, solved.split(sizes, 1), strict=True):
                parts[i] = part.unflatten(1, self.maps[i].values.shape)
        for i, inverse in reversed(list(zip(self._pixels, self._inverse, strict=True))):
            for j in range(i + 1, len(parts)):
                parts[i] = parts[i] - self._shared[i, j] * self.maps[j].spread(parts[j])
            parts[i] = parts[i] * inverse
        return torch.cat([part.flatten(1) for part in parts], 1)


def _cholesky(information: torch.Tensor) -> torch.Tensor:
    """Return the Cholesky factor of an information matrix, of which rounding may leave less than nothing somewhere."""
    ridge, unit = 0.0, torch.eye(len(information), dtype=information.dtype) * information.abs().max()
    while True:
        factor, failed = torch.linalg.cholesky_ex(information + ridge * unit)
        if not failed or ridge > len(information):
            return factor
        ridge = max(RIDGE_SHARE, 10 * ridge)
