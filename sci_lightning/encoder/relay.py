"""The relay lens: it images the modulator's mirrors onto the sensor's pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.encoder.square_kernel import reach, square_kernel


@dataclass(frozen=True)
class Pose:
    """Where the mask's image lies and how sharp it is; None is the nominal value.

    A mirror at m (x, y from the field's centre) is imaged to ``scale * R(angle) m + (dx, dy)``. x points right and y
    down; R turns x towards y: clockwise on the screen.

    Attributes:
        angle: rotation, radian. scale: magnification, 1. dx, dy: displacement, pixel. sigma: standard deviation of the
            blur on the image, pixel. All are tensors of no dimension.
    """

    angle: torch.Tensor | None = None
    scale: torch.Tensor | None = None
    dx: torch.Tensor | None = None
    dy: torch.Tensor | None = None
    sigma: torch.Tensor | None = None

    def image(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        """Return the image of touching square mirrors, integrated over the pixels; it is dark beyond the mirrors.

        The integral is exact without rotation; with rotation, a pixel's footprint on the mirrors is taken as upright.

        Args:
            patterns: ``(P, H, W)`` transmittance of the mirrors.
            cells: q, the number of cells along either axis of a pixel.

        Returns:
            ``(P, q H, q W)`` transmittance that each cell sees.
        """
        if all(value is None for value in vars(self).values()):
            return patterns.repeat_interleave(cells, -1).repeat_interleave(cells, -2) if cells > 1 else patterns
        height, width = patterns.shape[-2:]
        options: Any = {"device": patterns.device, "dtype": patterns.dtype}
        zero = torch.zeros((), **options)
        scale = torch.ones((), **options) if self.scale is None else self.scale
        y = (_centres(height, cells, options) - (zero if self.dy is None else self.dy)) / scale
        x = (_centres(width, cells, options) - (zero if self.dx is None else self.dx)) / scale
        sigma = None if self.sigma is None or float(self.sigma.detach()) < 1e-6 else self.sigma / scale
        pixel = 1 / (cells * scale)
        if self.angle is None:
            down = _shares(y + (height - 1) / 2, sigma, pixel, height)
            return down @ patterns @ _shares(x + (width - 1) / 2, sigma, pixel, width).T
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        row = cos * y[:, None] - sin * x + (height - 1) / 2
        column = cos * x + sin * y[:, None] + (width - 1) / 2
        return _turned(patterns, row, column, sigma, pixel)


def _centres(length: int, cells: int, options: Any) -> torch.Tensor:
    """Return the centres of the cells along an axis, in pixels from the centre of the field."""
    return (torch.arange(length * cells, **options) + 0.5) / cells - length / 2


def _taps(
    centre: torch.Tensor, sigma: torch.Tensor | None, pixel: torch.Tensor, length: int
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return (index, weight) pairs of all the mirrors that may light the pixels around ``centre``."""
    radius = reach(0.0 if sigma is None else float(sigma.detach()), float(pixel.detach()))
    first = torch.floor(centre.detach()).long()
    taps = []
    for step in range(1 - radius, radius + 1):
        index = first + step
        inside = (index >= 0) & (index < length)
        weight = square_kernel(centre - index, sigma, pixel) * inside
        taps.append((index.clamp(0, length - 1), weight))
    return taps


def _shares(centre: torch.Tensor, sigma: torch.Tensor | None, pixel: torch.Tensor, length: int) -> torch.Tensor:
    """Return ``(cells, length)``: how much every mirror lights every cell, along one axis."""
    return square_kernel(centre[:, None] - torch.arange(length).to(centre), sigma, pixel)


def _turned(
    patterns: torch.Tensor,
    row: torch.Tensor,
    column: torch.Tensor,
    sigma: torch.Tensor | None,
    pixel: torch.Tensor,
) -> torch.Tensor:
    height, width = patterns.shape[-2:]
    flat = patterns.flatten(-2)
    image = torch.zeros(())
    across = _taps(column, sigma, pixel, width)
    for line, down in _taps(row, sigma, pixel, height):
        for place, over in across:
            image = image + flat[:, (line * width + place).flatten()].view(-1, *line.shape) * (down * over)
    return image


def radians(degrees: torch.Tensor) -> torch.Tensor:
    """Convert degrees to radians."""
    return degrees * (math.pi / 180)
