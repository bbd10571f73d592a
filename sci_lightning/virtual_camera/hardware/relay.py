"""The relay: the lens that images the modulator's mirrors onto the pixels.

Its effects displace, turn, magnify, distort or blur that image. The last two (astigmatism and thermal drift) are
outside the vocabulary of a diagnosis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_matrix

from sci_lightning.virtual_camera.hardware.effect import Effect, parameter
from sci_lightning.virtual_camera.hardware.overlap import light_below, overlap, with_surround

MAX_STRETCH = 2.0
"""Cells on the mirrors may be so many times as large as in the middle; it bounds the memory."""
TABLE = 200_000
"""Entries of the table by which a radial distortion is inverted."""
MAX_ENTRIES = 4_000_000
"""Non-zero entries of the sparse matrix that is built at a time; they take about 50 MB."""


@dataclass(frozen=True)
class Relay:
    """Where the image of the mirrors lies on the pixels, and how sharp it is.

    A mirror at m (x, y from the centre of the field) would be seen at ``scale * R(angle) m + (dx, dy)``; x points right
    and y down; R turns x towards y, which is clockwise on the screen. Perspective and the lens then distort the picture
    about the centre of the field. The irradiance of the image equals the transmittance of the mirror at any
    magnification.

    Attributes:
        angle: rotation, radian.
        scale: magnification, 1.
        dx, dy: displacement to the right and down, pixel.
        sigma: standard deviation of the Gaussian blur, pixel.
        sigma_x: standard deviation of a further blur along x only, pixel.
        tilt_x, tilt_y: relative increase of the magnification from the centre to the right and to the lower edge.
        k: relative radial distance by which what belongs into a corner is seen further out; it grows with the square of
            the radius.
        spread: relative difference of the magnification of either of two colours from their mean.
        drift_x, drift_y: displacement that grows in even steps from the first to the last capture, pixel; none halfway.
    """

    angle: float = 0.0
    scale: float = 1.0
    dx: float = 0.0
    dy: float = 0.0
    sigma: float = 0.0
    sigma_x: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    k: float = 0.0
    spread: float = 0.0
    drift_x: float = 0.0
    drift_y: float = 0.0

    def during(self, capture: int, captures: int) -> Relay:
        """Return the relay as it is during one of so many captures."""
        time = capture / max(captures - 1, 1) - 0.5
        moved = {"dx": self.dx + time * self.drift_x, "dy": self.dy + time * self.drift_y}
        return replace(self, **moved, drift_x=0.0, drift_y=0.0) if self.drift_x or self.drift_y else self

    @property
    def colours(self) -> list[Relay]:
        """The relay as it is for either of two colours, or for all the light alike."""
        sides = (self.spread, -self.spread) if self.spread else (0.0,)
        return [replace(self, scale=self.scale * (1 + side), spread=0.0) for side in sides]

    @property
    def is_upright(self) -> bool:
        """Whether the borders of the mirrors' images are straight and parallel to those of the pixels."""
        return not (self.angle or self.tilt_x or self.tilt_y or self.k)

    @property
    def sigmas(self) -> tuple[float, float]:
        """Standard deviations of the blur along y and along x, pixel."""
        return self.sigma, math.hypot(self.sigma, self.sigma_x)

    def cells(self, size: tuple[int, int], oversampling: int, *, sharp_optics: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return the grid of cells within which the modulated light is taken as uniform.

        With ``sharp_optics`` and an upright image, whole pixels are exact, because only the light that a pixel collects
        matters. With blurred optics a sharp upright image is cut at the borders of pixels and mirrors, between which it
        is uniform; a rotated, distorted or blurred image is sampled by ``oversampling`` cells per pixel and axis.
        ``oversampling`` 1 gives whole pixels in any case.

        Args:
            size: (H, W) in pixels, of the field and what lies beyond it.
            oversampling: cells per pixel and axis where the image is not uniform piece by piece.
            sharp_optics: whether the lens behind the relay forms one sharp, undisplaced image.

        Returns:
            The edges of the cells along y and along x, ascending from 0 to H and to W.
        """
        pixels = [np.arange(length + 1.0) for length in size]
        if oversampling == 1 or (sharp_optics and self.is_upright):
            return pixels[0], pixels[1]
        if not self.is_upright or any(self.sigmas) or self.spread:
            count = min(oversampling, 4) if sharp_optics else oversampling
            return np.arange(count * size[0] + 1) / count, np.arange(count * size[1] + 1) / count
        down, across = self._mirror_edges(size)
        return _merge_edges(pixels[0], down), _merge_edges(pixels[1], across)

    def image(
        self, patterns: np.ndarray, rows: np.ndarray, columns: np.ndarray, surround: str, border: int = 0
    ) -> np.ndarray:
        """Return the image of square, touching mirrors, averaged over cells.

        The image is exact when it is upright. Otherwise the footprint of a cell on the mirrors is taken as an upright
        rectangle.

        Args:
            patterns: (P, H, W) transmittance of the mirrors, those beyond the field included.
            rows, columns: (n + 1,) and (m + 1,) edges of the cells; evenly spaced unless the image is upright.
            surround: what lies beyond the mirrors: ``dark``, or the ``edge`` mirrors repeated for ever.
            border: mirrors on each side that lie beyond the field, from whose size distortions are measured.

        Returns:
            (P, n, m) irradiance for a scene of irradiance 1.
        """
        if self.spread:
            seen = [colour.image(patterns, rows, columns, surround, border) for colour in self.colours]
            return np.mean(seen, axis=0)
        if not self.is_upright:
            return self._resampled(patterns, rows, columns, surround, border)
        axes = zip((rows, columns), self._mirror_edges(patterns.shape[1:]), self.sigmas, strict=True)
        down, across = (
            overlap(cells, with_surround(surround, mirrors), sigma) / np.diff(cells)[:, None]
            for cells, mirrors, sigma in axes
        )
        return down @ patterns @ across.T

    def _mirror_edges(self, size: tuple[int, ...]) -> list[np.ndarray]:
        """Return the borders of the mirrors' images along y and along x, for an upright image."""
        return [
            (np.arange(length + 1) - length / 2) * self.scale + length / 2 + shift
            for length, shift in zip(size, (self.dy, self.dx), strict=True)
        ]

    def _resampled(
        self, patterns: np.ndarray, rows: np.ndarray, columns: np.ndarray, surround: str, border: int
    ) -> np.ndarray:
        """Return the image by tracing every cell back to the mirrors, a strip of rows at a time to bound the memory."""
        count, height, width = patterns.shape
        field = (height - 2 * border, width - 2 * border)
        mirrors = patterns.reshape(count, -1).T
        y = (rows[1:] + rows[:-1]) / 2 - height / 2
        x = (columns[1:] + columns[:-1]) / 2 - width / 2
        cell = (rows[1] - rows[0]) / 2
        half = MAX_STRETCH * cell / self.scale
        sigma_v, sigma_u = (sigma / self.scale for sigma in self.sigmas)
        entries = len(x) * len(y) * _reach(half, sigma_v) * _reach(half, sigma_u)
        strips = []
        for strip in np.array_split(y, min(math.ceil(entries / MAX_ENTRIES), len(y))):
            seen_y, seen_x = (one.ravel() for one in np.broadcast_arrays(strip[:, None], x))
            v, u = self._mirror_at(seen_y, seen_x, field)
            half_v, half_u = self._footprints(seen_y, seen_x, cell, field)
            row, share_y = _footprint(v + height / 2, half_v, sigma_v, height, surround)
            column, share_x = _footprint(u + width / 2, half_u, sigma_u, width, surround)
            mirror = row[:, :, None] * width + column[:, None, :]
            share = share_y[:, :, None] * share_x[:, None, :]
            starts = np.arange(len(u) + 1) * share[0].size
            light = csr_matrix((share.ravel(), mirror.ravel(), starts), (len(u), height * width)) @ mirrors
            strips.append(light.T.reshape(count, len(strip), len(x)))
        return np.concatenate(strips, axis=1)

    def _mirror_at(self, y: np.ndarray, x: np.ndarray, field: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return (row, column) from the centre of the mirror that is seen at (y, x) from the centre of the field."""
        y, x = self._undistorted(y, x, field)
        y, x = y - self.dy, x - self.dx
        cos, sin = math.cos(self.angle) / self.scale, math.sin(self.angle) / self.scale
        return cos * y - sin * x, cos * x + sin * y

    def _undistorted(self, y: np.ndarray, x: np.ndarray, field: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return where (y, x) would be seen without perspective and without the lens' distortion."""
        height, width = field
        if self.k:
            corner = math.hypot(height, width) / 2
            farthest = min(3.0, (3 * abs(self.k)) ** -0.5) if self.k < 0 else 3.0  # beyond, a barrel folds over
            radius = np.linspace(0, farthest, TABLE)
            seen = np.maximum(np.hypot(y, x) / corner, 1e-9)
            stretch = np.interp(seen, radius * (1 + self.k * radius**2), radius) / seen
            y, x = y * stretch, x * stretch
        nearer = 1 + 2 * (self.tilt_x * x / width + self.tilt_y * y / height)
        return y / nearer, x / nearer

    def _footprints(
        self, y: np.ndarray, x: np.ndarray, cell: float, field: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return half the height and width, in mirrors, of the cells of half side ``cell`` around (y, x)."""
        if not (self.k or self.tilt_x or self.tilt_y):
            return np.full_like(y, cell / self.scale), np.full_like(x, cell / self.scale)
        above, below = (self._undistorted(y + side, x, field)[0] for side in (-cell, cell))
        left, right = (self._undistorted(y, x + side, field)[1] for side in (-cell, cell))
        return (below - above) / 2 / self.scale, (right - left) / 2 / self.scale


def _merge_edges(pixels: np.ndarray, mirrors: np.ndarray) -> np.ndarray:
    """Return the edges of the pixels and, between them, those of the mirrors that do not coincide with one."""
    inside = mirrors[(mirrors > pixels[0]) & (mirrors < pixels[-1])]
    return np.union1d(pixels, inside[np.abs(inside - np.round(inside)) > 1e-6])


def _reach(half: float, sigma: float) -> int:
    """Return how many mirrors in a row can send light into a footprint of half width ``half``, out to 5 sigma."""
    return math.ceil(2 * (half + 5 * sigma)) + 1


def _footprint(
    centre: np.ndarray, half: np.ndarray, sigma: float, length: int, surround: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return which of ``length`` mirrors light the footprints ``centre`` (n,) +- ``half`` (n,), and each one's share.

    Returns:
        Two arrays (n, K): the index of the mirror, and its share of the footprint's irradiance.
    """
    first = np.floor(centre - half - 5 * sigma).astype(np.int64)
    mirror = first[:, None] + np.arange(_reach(float(half.max()), sigma))
    z, half = centre[:, None] - mirror, half[:, None]
    share = (
        light_below(z + half, sigma)
        - light_below(z - half, sigma)
        - light_below(z + half - 1, sigma)
        + light_below(z - half - 1, sigma)
    )
    if surround == "dark":
        share *= (mirror >= 0) & (mirror < length)
    return mirror.clip(0, length - 1), np.maximum(share, 0) / (2 * half)


@dataclass(frozen=True)
class RelayEffect(Effect):
    """Moves, distorts or blurs the image of the mirrors; the scene stays as it is."""

    stage: ClassVar[str] = "relay"

    def apply(self, relay: Relay) -> Relay:
        """Return the relay with this fault, whose parameters are attributes of the relay unless it says otherwise."""
        return replace(relay, **vars(self))


@dataclass(frozen=True)
class MaskShift(RelayEffect):
    """The mirrors' image lies ``dx`` to the right and ``dy`` further down: exact overlap of squares with pixels."""

    name = "mask_shift"
    dx: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)


@dataclass(frozen=True)
class MaskRotation(RelayEffect):
    """The mirrors' image is turned about its centre, positive from +x to +y: clockwise on the screen."""

    name = "mask_rotation"
    angle: float = parameter("degree", -45, 45, (0.15, 1.2), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, angle=math.radians(self.angle))


@dataclass(frozen=True)
class MaskScale(RelayEffect):
    """The mirrors' image is ``scale`` times as large, about its centre: exact overlap of squares with pixels."""

    name = "mask_scale"
    scale: float = parameter("1", 0.5, 2, (0.003, 0.02), neutral=1.0, signed=True)


@dataclass(frozen=True)
class LateralColour(RelayEffect):
    """The mirrors' image in one colour is larger by ``spread``, in another one of as much light smaller."""

    name = "lateral_colour"
    spread: float = parameter("1", 0, 0.1, (0.004, 0.02), neutral=0.0)


@dataclass(frozen=True)
class MaskBlur(RelayEffect):
    """The mirrors are out of focus, the scene is not: squares blurred by a Gaussian, integrated in closed form."""

    name = "mask_blur"
    sigma: float = parameter("pixel", 0, 4, (0.25, 1.2), neutral=0.0)


@dataclass(frozen=True)
class MaskKeystone(RelayEffect):
    """The modulator is tilted: its image is larger at the right edge by ``tilt_x`` and at the lower one by ``tilt_y``.

    Perspective: the mirror seen at (x, y) from the centre is the one at (x, y) / (1 + 2 tilt_x x / W + 2 tilt_y y / H).
    """

    name = "mask_keystone"
    tilt_x: float = parameter("1", -0.3, 0.3, (0.006, 0.03), neutral=0.0, signed=True)
    tilt_y: float = parameter("1", -0.3, 0.3, (0.006, 0.03), neutral=0.0, signed=True)


@dataclass(frozen=True)
class MaskDistortion(RelayEffect):
    """Straight rows of mirrors appear bent: what belongs at radius r is seen at r (1 + k (r / R)**2).

    R is half the diagonal of the field; negative values make a barrel.
    """

    name = "mask_distortion"
    k: float = parameter("1", -0.3, 0.3, (0.01, 0.05), neutral=0.0, signed=True)


@dataclass(frozen=True)
class MaskAstigmatism(RelayEffect):
    """The mirrors' image is blurred along x and sharp along y."""

    name = "mask_astigmatism"
    sigma: float = parameter("pixel", 0, 4, (0.4, 1.5), neutral=0.0)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, sigma_x=self.sigma)


@dataclass(frozen=True)
class MaskDrift(RelayEffect):
    """The mount warms up: the mirrors' image moves evenly by (``dx``, ``dy``) from the first to the last capture.

    Halfway it lies where it should.
    """

    name = "mask_drift"
    dx: float = parameter("pixel", -32, 32, (0.2, 0.8), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.2, 0.8), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, drift_x=self.dx, drift_y=self.dy)
