"""The signal on its way to the converter: mean and variance of every pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch


@dataclass(frozen=True)
class Signal:
    """Mean and variance of every pixel, and where in the field the pixels are.

    Attributes:
        mean: ``(N, H, W)`` expected signal, 1 at full scale; ``(N, q H, q W)`` while a pixel counts as q x q cells.
        variance: ``(N, H, W)`` or one that broadcasts to it; of the mean's unit squared.
        exposure: ``(N, 1, 1)`` integration time relative to nominal: dark signal scales with it.
        dn: the fraction of full scale that is one DN.
        origin: (row, column) of the first pixel within the field.
        field: (height, width) of the whole field, of which these pixels may be a window.
        cells: q; 1 from the sensor on.
        position: ``(N,)`` integers, where each capture stands in its file, for what drifts from capture to capture;
            None: the snapshots have no order.
        recorded_before: ``(N, H, W)`` what was recorded just before each capture, 1 at full scale, for what one capture
            leaves to the next; None: the snapshots have no order.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    exposure: torch.Tensor
    dn: float
    origin: tuple[int, int]
    field: tuple[int, int]
    cells: int = 1
    position: torch.Tensor | None = None
    recorded_before: torch.Tensor | None = None

    def with_mean(self, mean: torch.Tensor) -> Signal:
        """Return the signal with another mean."""
        return replace(self, mean=mean)

    def with_moments(self, mean: torch.Tensor, variance: torch.Tensor) -> Signal:
        """Return the signal with another mean and variance."""
        return replace(self, mean=mean, variance=variance)

    def pooled(self) -> Signal:
        """Return the signal of whole pixels: the mean over the cells of each."""
        if self.cells == 1:
            return self
        mean = torch.nn.functional.avg_pool2d(self.mean[:, None], self.cells)[:, 0]
        return replace(self, mean=mean, cells=1)

    def window(self, field_map: torch.Tensor) -> torch.Tensor:
        """Return the part that these pixels see of a map ``(H, W)``, ``(1, W)`` or ``(H, 1)`` of the whole field."""
        (top, left), (height, width) = self.origin, self.mean.shape[-2:]
        rows = slice(top, top + height) if field_map.shape[-2] > 1 else slice(None)
        columns = slice(left, left + width) if field_map.shape[-1] > 1 else slice(None)
        return field_map[..., rows, columns]

    def coordinates(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return y ``(H, 1)`` and x ``(1, W)`` of the centres of pixels or cells, in pixels from the field's centre."""
        y, x = (
            (torch.arange(length).to(self.mean) + 0.5) / self.cells + first - full / 2
            for length, first, full in zip(self.mean.shape[-2:], self.origin, self.field, strict=True)
        )
        return y[:, None], x[None]

    def squared_radius(self) -> torch.Tensor:
        """Return the distance ``(H, W)`` from the field's centre over that of the corner pixel's centre, squared."""
        y, x = self.coordinates()
        return (y.square() + x.square()) / sum(((length - 1) / 2) ** 2 for length in self.field)
