"""The relay lens: it images the modulator's mirrors onto the sensor's pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.encoder.square_kernel import reach, square_kernel

NEWTON_STEPS = 6
"""Steps after which the inverse of a radial distortion is exact to rounding, for any in range."""


@dataclass(frozen=True)
class Pose:
    """Where the mask's image lies and how sharp it is; None is the nominal value.

    A mirror at m (x, y from the field's centre) is imaged to p = ``scale * R(angle) m + (dx, dy)``. x points right and
    y down; R turns x towards y: clockwise on the screen. Perspective then moves it to q with
    p = q / (1 + tilt_x q_x / (W / 2) + tilt_y q_y / (H / 2)), and the lens to q (1 + k q^2 / R^2), R being half the
    diagonal of the field.

    Attributes:
        angle: rotation, radian. scale: magnification, 1. dx, dy: displacement, pixel. sigma: standard deviation of the
            blur on the image, pixel. tilt_x, tilt_y: change of magnification from the centre to the right and to the
            lower edge, 1. k: radial distortion in the corner, 1. All are tensors of no dimension.
    """

    angle: torch.Tensor | None = None
    scale: torch.Tensor | None = None
    dx: torch.Tensor | None = None
    dy: torch.Tensor | None = None
    sigma: torch.Tensor | None = None
    tilt_x: torch.Tensor | None = None
    tilt_y: torch.Tensor | None = None
    k: torch.Tensor | None = None

    def image(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        """Return the image of touching square mirrors, integrated over the pixels; it is dark beyond the mirrors.

        The integral is exact without rotation, perspective and distortion; with them, a pixel's footprint on the
        mirrors is taken as an upright rectangle.

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
        sigma = None if self.sigma is None or float(self.sigma.detach()) < 1e-6 else self.sigma / scale
        if self.k is not None or self.tilt_x is not None:
            return self._distorted(patterns, cells, sigma, scale)
        y = (_centres(height, cells, options) - (zero if self.dy is None else self.dy)) / scale
        x = (_centres(width, cells, options) - (zero if self.dx is None else self.dx)) / scale
        pixel = 1 / (cells * scale)
        if self.angle is None:
            down = _shares(y + (height - 1) / 2, sigma, pixel, height)
            return down @ patterns @ _shares(x + (width - 1) / 2, sigma, pixel, width).T
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        row = cos * y[:, None] - sin * x + (height - 1) / 2
        column = cos * x + sin * y[:, None] + (width - 1) / 2
        return _turned(patterns, row, column, sigma, (pixel, pixel))

    def _distorted(
        self, patterns: torch.Tensor, cells: int, sigma: torch.Tensor | None, scale: torch.Tensor
    ) -> torch.Tensor:
        """Return the image if its magnification differs from place to place."""
        height, width = patterns.shape[-2:]
        options: Any = {"device": patterns.device, "dtype": patterns.dtype}
        y, x = _centres(height, cells, options)[:, None], _centres(width, cells, options)[None]
        row, column = self._mirror_at(y, x, (height, width), scale)
        half = 0.5 / cells
        above, below = (self._mirror_at(y + side, x, (height, width), scale)[0] for side in (-half, half))
        left, right = (self._mirror_at(y, x + side, (height, width), scale)[1] for side in (-half, half))
        return _turned(patterns, row, column, sigma, ((below - above).abs(), (right - left).abs()))

    def _mirror_at(
        self, y: torch.Tensor, x: torch.Tensor, size: tuple[int, int], scale: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return row and column of the mirror that is seen at places y ``(h, 1)`` and x ``(1, w)`` from the centre."""
        height, width = size
        y, x = torch.broadcast_tensors(y, x)
        if self.k is not None:
            far = self.k * (y.square() + x.square()) * (4 / (height**2 + width**2))
            part = torch.ones_like(far)
            for _ in range(NEWTON_STEPS):  # q = part * seen, where part + far * part**3 = 1
                step = (part + far * part**3 - 1) / (1 + 3 * far * part.square()).clamp(min=0.1)
                part = (part - step).clamp(0.5, 1.5)  # at 1.5 a barrel folds over; beyond, no mirror is seen
            y, x = y * part, x * part
        if self.tilt_x is not None and self.tilt_y is not None:
            nearer = (1 + self.tilt_x * x * (2 / width) + self.tilt_y * y * (2 / height)).clamp(min=0.1)
            y, x = y / nearer, x / nearer
        y, x = (y if self.dy is None else y - self.dy) / scale, (x if self.dx is None else x - self.dx) / scale
        if self.angle is not None:
            cos, sin = torch.cos(self.angle), torch.sin(self.angle)
            y, x = cos * y - sin * x, cos * x + sin * y
        return y + (height - 1) / 2, x + (width - 1) / 2


def _centres(length: int, cells: int, options: Any) -> torch.Tensor:
    """Return the centres of the cells along an axis, in pixels from the centre of the field."""
    return (torch.arange(length * cells, **options) + 0.5) / cells - length / 2


def _taps(
    centre: torch.Tensor, sigma: torch.Tensor | None, pixel: torch.Tensor, length: int
) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return (index, weight) pairs of all the mirrors that may light the pixels around ``centre``."""
    radius = reach(0.0 if sigma is None else float(sigma.detach()), float(pixel.detach().max()))
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
    pixel: tuple[torch.Tensor, torch.Tensor],
) -> torch.Tensor:
    """Return the image of mirrors seen at fields of rows and columns, of pixels so high and wide in mirrors."""
    height, width = patterns.shape[-2:]
    flat = patterns.flatten(-2)
    image = torch.zeros(())
    across = _taps(column, sigma, pixel[1], width)
    for line, down in _taps(row, sigma, pixel[0], height):
        for place, over in across:
            image = image + flat[:, (line * width + place).flatten()].view(-1, *line.shape) * (down * over)
    return image


def radians(degrees: torch.Tensor) -> torch.Tensor:
    """Convert degrees to radians."""
    return degrees * (math.pi / 180)
