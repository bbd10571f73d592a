"""The relay: the lens that images the mirrors onto the pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_matrix

from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.overlap import lit, overlap, sources_with
from sci_lightning.virtual_camera.hardware.parameter import parameter

ENTRIES = 4_000_000
"""Of a sparse matrix at a time; about 50 MB."""


@dataclass(frozen=True)
class Relay:
    """Where the mirrors' image lies, and how sharp it is.

    A mirror at m (x, y from the middle) is seen at ``scale * R(angle) m + (dx, dy)``, so that (dx, dy) is where the
    middle went whatever else is wrong. x points right and y down; R turns x towards y: clockwise on the screen.
    The light on the image is the mirror's transmittance, however large the image.

    Attributes:
        angle: radian. scale: 1. dx, dy: pixel. sigma: of the blur, pixel.
        across: of a further blur, along x only, pixel.
        keystone: how much larger the image is at its lower end than in the middle, and smaller at its upper end.
        barrel: how much further out the mirror lies that is seen in a corner, relative; grows with the radius squared.
    """

    angle: float = 0.0
    scale: float = 1.0
    dx: float = 0.0
    dy: float = 0.0
    sigma: float = 0.0
    across: float = 0.0
    keystone: float = 0.0
    barrel: float = 0.0

    @property
    def upright(self) -> bool:
        """Whether the mirrors' borders are straight lines along the pixels'."""
        return not (self.angle or self.keystone or self.barrel)

    @property
    def sigmas(self) -> tuple[float, float]:
        """Of the blur down and across, pixel."""
        return self.sigma, math.hypot(self.sigma, self.across)

    def cells(self, size: tuple[int, int], oversampling: int, *, sharp: bool) -> tuple[np.ndarray, np.ndarray]:
        """The edges, down and across, of the cells in each of which the light counts as even.

        Whole pixels do when the lens that follows is ``sharp``: only what a pixel collects matters then. Else the
        squares are cut at the edges of pixels and of mirrors, within which it is even; and a turned, bent or blurred
        image into ``oversampling`` cells per pixel and axis. ``oversampling`` 1 asks for whole pixels in any case.
        """
        pixels = [np.arange(length + 1.0) for length in size]
        if oversampling == 1 or (sharp and self.upright):
            return pixels[0], pixels[1]
        if not self.upright or any(self.sigmas):
            parts = min(oversampling, 4) if sharp else oversampling
            return np.arange(parts * size[0] + 1) / parts, np.arange(parts * size[1] + 1) / parts
        down, across = self._borders(size)
        return _cut(pixels[0], down), _cut(pixels[1], across)

    def image(self, patterns: np.ndarray, rows: np.ndarray, columns: np.ndarray, surround: str) -> np.ndarray:
        """The image of square, touching mirrors, averaged over cells.

        Args:
            patterns: (P, H, W) transmittance of the mirrors.
            rows, columns: (n + 1,) and (m + 1,) edges of the cells; evenly spaced unless the relay is upright.
            surround: what lies beyond the mirrors: ``dark``, or the ``edge`` mirrors going on.

        Returns:
            (P, n, m). Exact when upright; else a cell's footprint on the mirrors is taken as an upright square, of the
            same size everywhere.
        """
        if not self.upright:
            return self._turned(patterns, rows, columns, surround)
        axes = zip((rows, columns), self._borders(patterns.shape[1:]), self.sigmas, strict=True)
        down, across = (
            overlap(cells, sources_with(surround, mirrors), sigma) / np.diff(cells)[:, None]
            for cells, mirrors, sigma in axes
        )
        return down @ patterns @ across.T

    def _borders(self, size: tuple[int, ...]) -> list[np.ndarray]:
        """Edges of the mirrors' images, down and across, when upright."""
        return [
            (np.arange(length + 1) - length / 2) * self.scale + length / 2 + shift
            for length, shift in zip(size, (self.dy, self.dx), strict=True)
        ]

    def _turned(self, patterns: np.ndarray, rows: np.ndarray, columns: np.ndarray, surround: str) -> np.ndarray:
        count, height, width = patterns.shape
        mirrors = patterns.reshape(count, -1).T
        y = (rows[1:] + rows[:-1]) / 2 - height / 2 - self.dy
        x = (columns[1:] + columns[:-1]) / 2 - width / 2 - self.dx
        cos, sin = math.cos(self.angle) / self.scale, math.sin(self.angle) / self.scale
        half, sigma, wide = ((rows[1] - rows[0]) / 2 / self.scale, *(each / self.scale for each in self.sigmas))
        parts = math.ceil(len(x) * len(y) * _window(half, sigma) * _window(half, wide) / ENTRIES)
        strips = []
        for some in np.array_split(y, min(parts, len(y))):
            u, v = (cos * x + sin * some[:, None]).ravel(), (cos * some[:, None] - sin * x).ravel()
            bent = 1 + self.barrel * 4 * (u**2 + v**2) / (width**2 + height**2)
            bent /= 1 + self.keystone * 2 * v / height
            u, v = u * bent + width / 2, v * bent + height / 2
            column, across = _collected(u, half, wide, width, surround)
            line, down = _collected(v, half, sigma, height, surround)
            mirror = line[:, :, None] * width + column[:, None, :]
            share = down[:, :, None] * across[:, None, :]
            starts = np.arange(len(u) + 1) * share[0].size
            light = csr_matrix((share.ravel(), mirror.ravel(), starts), (len(u), height * width)) @ mirrors
            strips.append(light.T.reshape(count, len(some), len(x)))
        return np.concatenate(strips, axis=1)


def _cut(pixels: np.ndarray, mirrors: np.ndarray) -> np.ndarray:
    """The edges of pixels, and those of mirrors between them."""
    inside = mirrors[(mirrors > pixels[0]) & (mirrors < pixels[-1])]
    return np.union1d(pixels, inside[np.abs(inside - np.round(inside)) > 1e-6])  # a sliver is no cell


def _window(half: float, sigma: float) -> int:
    """How many mirrors in a row can reach a footprint of this half width."""
    return math.ceil(2 * (half + 5 * sigma)) + 1


def _collected(
    centre: np.ndarray, half: float, sigma: float, length: int, surround: str
) -> tuple[np.ndarray, np.ndarray]:
    """Which mirrors light the footprints around ``centre`` (n,), and with what share: (n, K) each."""
    first = np.floor(centre - half - 5 * sigma).astype(np.int64)
    mirror = first[:, None] + np.arange(_window(half, sigma))
    z = centre[:, None] - mirror
    share = lit(z + half, sigma) - lit(z - half, sigma) - lit(z + half - 1, sigma) + lit(z - half - 1, sigma)
    if surround == "dark":
        share *= (mirror >= 0) & (mirror < length)
    return mirror.clip(0, length - 1), np.maximum(share, 0) / (2 * half)


@dataclass(frozen=True)
class RelayEffect(Effect):
    """Moves or blurs the mirrors' image; the scene stays as it is."""

    stage: ClassVar[str] = "relay"

    def misalign(self, relay: Relay) -> Relay:
        """The relay with this fault."""
        return relay


@dataclass(frozen=True)
class MaskShift(RelayEffect):
    """The mirrors' image lies ``dx`` to the right and ``dy`` further down: exact overlap of squares with pixels."""

    name = "mask_shift"
    dx: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, dx=self.dx, dy=self.dy)


@dataclass(frozen=True)
class MaskRotation(RelayEffect):
    """The mirrors' image is turned about its middle, positive from +x to +y: clockwise on the screen."""

    name = "mask_rotation"
    angle: float = parameter("degree", -45, 45, (0.15, 1.2), neutral=0.0, signed=True)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, angle=math.radians(self.angle))


@dataclass(frozen=True)
class MaskScale(RelayEffect):
    """The mirrors' image is ``scale`` times as large, about its middle: exact overlap of squares with pixels."""

    name = "mask_scale"
    scale: float = parameter("1", 0.5, 2, (0.003, 0.02), neutral=1.0, signed=True)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, scale=self.scale)


@dataclass(frozen=True)
class MaskBlur(RelayEffect):
    """The mirrors are out of focus, the scene is not: squares blurred by a Gaussian, integrated in closed form."""

    name = "mask_blur"
    sigma: float = parameter("pixel", 0, 4, (0.25, 1.2), neutral=0.0)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, sigma=self.sigma)
