"""The values of all fixed-pattern maps at once: the information about them, and its inverse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from sci_lightning.diagnosis.model.capture_map import CaptureMap
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap

DENSE = ("row", "column", "smooth", "capture")
"""Kinds of maps with few values, each of which many pixels share."""
RIDGE_SHARE = 1e-10
"""Part of the largest entry that is added to the diagonal first, where rounding leaves no Cholesky factor."""


class MapSystem:
    """The information about the values of all maps, and its inverse.

    Maps of pixels are eliminated one after the other, pixel by pixel; what remains couples rows, columns, smooth
    functions and errors of captures and is small and dense. The values of all maps stand in one vector, map after map,
    S in all.

    Args:
        maps: any number.
        information: ``(N, H, W)`` about the mean of every fitted pixel, 0 for held-out ones.
    """

    def __init__(self, maps: Sequence[FixedPatternMap], information: torch.Tensor) -> None:
        self.maps = sorted(maps, key=lambda one: one.kind in DENSE)
        self.information = information
        self._pixels = [i for i, one in enumerate(self.maps) if one.kind not in DENSE]
        self._lines = [i for i, one in enumerate(self.maps) if one.kind in DENSE]
        indices = range(len(self.maps))
        self._shared = {(i, j): self._product(i, j, information) for i in indices for j in indices[i + 1 :]}
        self._inverse: list[torch.Tensor] = []
        self._columns: dict[tuple[int, int], torch.Tensor] = {}
        own = {i: self.maps[i].precision for i in self._pixels}
        lost = {j: torch.zeros(information.shape[1:], dtype=torch.float64) for j in self._lines}
        of_captures: dict[tuple[int, int], torch.Tensor] = {}
        for i in self._pixels:
            inverse = torch.where(self.maps[i].active, 1 / own[i], 0.0)
            self._inverse.append(inverse)
            later = indices[i + 1 :]
            for j in later:
                if isinstance(one := self.maps[j], CaptureMap):
                    self._columns[i, j] = one.functions.columns(self._shared[i, j]).flatten(1)
            for j in later:
                taken = self._shared[i, j] * inverse
                if j in own:
                    own[j] = own[j] - taken * self._shared[i, j]
                elif (i, j) not in self._columns:
                    lost[j] = lost[j] + taken * self._shared[i, j]
                for k in indices[j + 1 :]:
                    if (i, j) not in self._columns or (i, k) not in self._columns:
                        self._shared[j, k] = self._shared[j, k] - taken * self._shared[i, k]
                for k in indices[j:]:
                    if (i, j) in self._columns and (i, k) in self._columns:
                        both = (self._columns[i, j] * inverse.flatten().float()) @ self._columns[i, k].T
                        of_captures[j, k] = of_captures.get((j, k), 0.0) + both.double()
        self._dense = self._line_matrix(lost, of_captures)

    def _product(self, i: int, j: int, information: torch.Tensor) -> torch.Tensor:
        """Return the information that two maps share: ``(H, W)``; ``(N, H, W)`` with errors of captures."""
        product = self.maps[i].jacobian * self.maps[j].jacobian * information
        errors = any(isinstance(self.maps[place], CaptureMap) for place in (i, j))
        return product if errors else product.sum(0).double()

    def _line_matrix(
        self, lost: Mapping[int, torch.Tensor], of_captures: Mapping[tuple[int, int], torch.Tensor]
    ) -> torch.Tensor:
        """Return the Cholesky factor of the information about all values that many pixels share.

        Args:
            lost: ``(H, W)`` information about every pixel that maps of pixels take away, by map.
            of_captures: the same about the values of two maps of errors of captures.
        """
        blocks = []
        for i in self._lines:
            across = []
            for j in self._lines:
                pair = min(i, j), max(i, j)
                block = (
                    self.maps[i].line_information(lost[i])
                    if i == j
                    else self.maps[i].shared_information(self.maps[j], self._shared[pair])
                )
                if pair in of_captures:
                    block = block - (of_captures[pair] if i <= j else of_captures[pair].T)
                across.append(block)
            blocks.append(torch.cat(across, 1))
        return _cholesky(torch.cat(blocks)) if blocks else torch.zeros(0, 0)

    @property
    def gradient(self) -> torch.Tensor:
        """``(S,)`` gradient of the penalised log-likelihood with respect to every value."""
        return torch.cat([one.gradient.flatten() for one in self.maps]) if self.maps else torch.zeros(0).double()

    def own_precision(self, one: FixedPatternMap) -> torch.Tensor:
        """Return the information ``(K, K)`` about the values of one map, prior included, all others eliminated."""
        place = next(i for i, other in enumerate(self.maps) if other.name == one.name)
        first = sum(other.values.numel() for other in self.maps[:place])
        some = slice(first, first + one.values.numel())
        units = torch.zeros(one.values.numel(), sum(other.values.numel() for other in self.maps), dtype=torch.float64)
        units[:, some] = torch.eye(one.values.numel(), dtype=torch.float64)
        covariance = self.solve(units)[:, some]
        return torch.linalg.pinv((covariance + covariance.T) / 2, hermitian=True)

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
                parts[j] = parts[j] - self._reduced(i, j, inverse * parts[i])
        if self._lines:
            stacked = torch.cat([parts[i].flatten(1) for i in self._lines], 1)
            solved = torch.cholesky_solve(stacked.T, self._dense).T
            sizes = [self.maps[i].values.numel() for i in self._lines]
            for i, part in zip(self._lines, solved.split(sizes, 1), strict=True):
                parts[i] = part.unflatten(1, self.maps[i].values.shape)
        for i, inverse in reversed(list(zip(self._pixels, self._inverse, strict=True))):
            for j in range(i + 1, len(parts)):
                parts[i] = parts[i] - self._spread(i, j, parts[j])
            parts[i] = parts[i] * inverse
        return torch.cat([part.flatten(1) for part in parts], 1)

    def _reduced(self, i: int, j: int, fields: torch.Tensor) -> torch.Tensor:
        """Return what fields ``(K, H, W)`` of a map of pixels add to the values of another map."""
        if (i, j) in self._columns:
            return (fields.flatten(1).float() @ self._columns[i, j].T).double().unflatten(1, self.maps[j].values.shape)
        return self.maps[j].reduce(self._shared[i, j] * fields)

    def _spread(self, i: int, j: int, values: torch.Tensor) -> torch.Tensor:
        """Return what values of a map add to fields ``(K, H, W)`` of a map of pixels."""
        if (i, j) in self._columns:
            return (values.flatten(1).float() @ self._columns[i, j]).double().unflatten(1, self.maps[i].values.shape)
        return self._shared[i, j] * self.maps[j].spread(values)


def _cholesky(information: torch.Tensor) -> torch.Tensor:
    """Return the Cholesky factor of an information matrix, of which rounding may leave less than nothing somewhere."""
    ridge, unit = 0.0, torch.eye(len(information), dtype=information.dtype) * information.abs().max()
    while True:
        factor, failed = torch.linalg.cholesky_ex(information + ridge * unit)
        if not failed or ridge > len(information):
            return factor
        ridge = max(RIDGE_SHARE, 10 * ridge)
