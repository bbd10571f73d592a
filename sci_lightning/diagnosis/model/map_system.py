"""All maps of a model at once: how they share what the captures say, solved exactly."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.diagnosis.model.fixed_pattern_map import Chart


class ChartSystem:
    """The information about the values of all maps, and its inverse.

    Maps of pixels are eliminated one after the other, pixel by pixel; what remains couples rows with columns and is
    small and dense. Values of all maps stand in one vector, map after map, S in all.

    Args:
        charts: the maps.
        weight: ``(N, H, W)`` information about the mean.
    """

    def __init__(self, charts: Sequence[Chart], weight: torch.Tensor) -> None:
        self.charts = sorted(charts, key=lambda chart: chart.kind in ("row", "column"))
        self._pixels = [i for i, chart in enumerate(self.charts) if chart.kind not in ("row", "column")]
        self._lines = [i for i, chart in enumerate(self.charts) if chart.kind in ("row", "column")]
        several = range(len(self.charts))
        self._shared = {
            (i, j): (self.charts[i].jacobian * self.charts[j].jacobian * weight).sum(0).double()
            for i in several
            for j in several[i + 1 :]
        }
        self._inverse: list[torch.Tensor] = []
        own = [chart.precision for chart in self.charts]
        for i in self._pixels:
            inverse = torch.where(self.charts[i].active, 1 / own[i], 0.0)
            self._inverse.append(inverse)
            later = several[i + 1 :]
            for j in later:
                taken = self._shared[i, j] * inverse
                own[j] = own[j] - self.charts[j].reduce(taken * self._shared[i, j])
                for k in several[j + 1 :]:
                    self._shared[j, k] = self._shared[j, k] - taken * self._shared[i, k]
        self._dense = self._line_matrix(own)

    def _line_matrix(self, own: list[torch.Tensor]) -> torch.Tensor:
        """Cholesky factor of the information about all rows and columns."""
        blocks = []
        for i in self._lines:
            across = []
            for j in self._lines:
                if i == j:
                    across.append(torch.diag(own[i].flatten()))
                    continue
                shared = self._shared[min(i, j), max(i, j)]
                if self.charts[i].kind == self.charts[j].kind:
                    across.append(torch.diag(self.charts[i].reduce(shared).flatten()))
                else:
                    across.append(shared if self.charts[i].kind == "row" else shared.T)
            blocks.append(torch.cat(across, 1))
        return torch.linalg.cholesky(torch.cat(blocks)) if blocks else torch.zeros(0, 0)

    @property
    def pull(self) -> torch.Tensor:
        """``(S,)``: slope of the penalised log-likelihood by every value."""
        return torch.cat([chart.pull.flatten() for chart in self.charts]) if self.charts else torch.zeros(0).double()

    def cross(self, weighted: torch.Tensor) -> torch.Tensor:
        """``(K, S)``: information that the values share with changes of the mean ``(K, N, H, W)`` times its weight."""
        found = [chart.cross(weighted).flatten(1) for chart in self.charts]
        return torch.cat(found, 1) if found else torch.zeros(len(weighted), 0, dtype=torch.float64)

    def parts(self, values: torch.Tensor) -> list[torch.Tensor]:
        """``(K, S)`` as one ``(K, *map)`` for each map."""
        sizes = [chart.values.numel() for chart in self.charts]
        return [
            part.unflatten(1, chart.values.shape)
            for chart, part in zip(self.charts, values.split(sizes, 1), strict=True)
        ]

    def solve(self, right: torch.Tensor) -> torch.Tensor:
        """The inverse information times ``(K, S)``."""
        if not self.charts:
            return right
        parts = self.parts(right)
        for i, inverse in zip(self._pixels, self._inverse, strict=True):
            for j in range(i + 1, len(parts)):
                parts[j] = parts[j] - self.charts[j].reduce(self._shared[i, j] * inverse * parts[i])
        if self._lines:
            stacked = torch.cat([parts[i].flatten(1) for i in self._lines], 1)
            solved = torch.cholesky_solve(stacked.T, self._dense).T
            sizes = [self.charts[i].values.numel() for i in self._lines]
            for i, part in zip(self._lines, solved.split(sizes, 1), strict=True):
                parts[i] = part.unflatten(1, self.charts[i].values.shape)
        for i, inverse in reversed(list(zip(self._pixels, self._inverse, strict=True))):
            for j in range(i + 1, len(parts)):
                parts[i] = parts[i] - self._shared[i, j] * parts[j]
            parts[i] = parts[i] * inverse
        return torch.cat([part.flatten(1) for part in parts], 1)
