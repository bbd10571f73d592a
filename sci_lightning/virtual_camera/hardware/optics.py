"""The optics: the modulated light on its way to the pixels. Its effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sci_lightning.virtual_camera.hardware.effect import Effect, Maps, choice, parameter
from sci_lightning.virtual_camera.hardware.overlap import one_by_one, overlap, with_surround

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session

LAMPS = 5
"""Patches of light that uneven illumination consists of."""


@dataclass(frozen=True)
class Image:
    """One of the images that the lens forms of the modulated light; an ideal lens forms one that is sharp.

    Attributes:
        share: part of the light in this image.
        dx, dy: displacement to the right and down, pixel.
        sigma: standard deviation of its Gaussian blur, pixel.
        sigma_x: standard deviation of a further blur along x only, pixel.
        centre, corner: standard deviation of a further blur in the centre of the field and in the corner pixels'
            centres, pixel; it changes with the square of the radius.
    """

    share: float = 1.0
    dx: float = 0.0
    dy: float = 0.0
    sigma: float = 0.0
    sigma_x: float = 0.0
    centre: float = 0.0
    corner: float = 0.0

    @property
    def varies(self) -> bool:
        """Whether the blur differs from place to place."""
        return self.centre != self.corner

    def sigma_at(self, y: np.ndarray | float, x: np.ndarray | float, field: tuple[float, float]) -> np.ndarray:
        """Return the standard deviation of the blur, but for that along x only, at (y, x) from the field's middle.

        Args:
            y, x: pixel.
            field: (H, W).
        """
        corner = ((field[0] - 1) ** 2 + (field[1] - 1) ** 2) / 4
        return np.hypot(self.sigma, self.centre + (self.corner - self.centre) * (y**2 + x**2) / corner)

    def onto_pixels(
        self, rows: np.ndarray, columns: np.ndarray, surround: str, border: int
    ) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from the light of cells to that which every pixel (H, W) receives from this image.

        It takes (n, m) irradiance, uniform within every cell, which is blurred and integrated in closed form; where the
        blur varies, every cell is by itself.

        Args:
            rows, columns: (n + 1,) and (m + 1,) edges of the cells, pixel.
            surround: what lies beyond the field, ``dark`` or ``edge``.
            border: pixels on each side that lie beyond the field.
        """
        sides = (rows[-1] - 2 * border, columns[-1] - 2 * border)
        y, x = ((cells[1:] + cells[:-1]) / 2 - cells[-1] / 2 for cells in (rows, columns))
        targets = [np.arange(cells[-1] + 1) for cells in (rows, columns)]
        top, left = with_surround(surround, rows + self.dy), with_surround(surround, columns + self.dx)
        if not self.varies:
            same = float(self.sigma_at(0.0, 0.0, sides))
            down, across = overlap(targets[0], top, same), overlap(targets[1], left, np.hypot(same, self.sigma_x))
            return lambda light: self.share * (down @ light @ across.T)
        lines = []
        for number, place in enumerate(y):
            sigma = self.sigma_at(place, x, sides)
            edges = np.tile(top[number : number + 2, None], len(x))
            down = one_by_one(targets[0], edges[0], edges[1], sigma)
            lines.append((down, one_by_one(targets[1], left[:-1], left[1:], np.hypot(sigma, self.sigma_x)).T))
        return lambda light: (
            self.share * sum((down * own) @ across for own, (down, across) in zip(light, lines, strict=True))
        )


@dataclass(frozen=True)
class OpticsEffect(Effect):
    """Changes the images that the lens forms, or the irradiance of the pixels afterwards."""

    stage: ClassVar[str] = "optics"

    def apply(self, images: list[Image]) -> list[Image]:
        """Return the images with this fault."""
        return images

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        """Return the irradiance (N, H, W) of the pixels with this fault.

        Args:
            light: (N, H, W) irradiance without it, 1 at full scale.
            exposure: (N,) integration time of every capture relative to nominal.
            fixed_maps: the camera's own maps by the name of their effect.
        """
        return light


@dataclass(frozen=True)
class Ghost(OpticsEffect):
    """A reflection: a ``fraction`` of the light forms a second image (dx, dy) away. Outside the vocabulary."""

    name = "ghost"
    fraction: float = parameter("1", 0, 0.5, (0.03, 0.12), neutral=0.0)
    dx: float = parameter("pixel", -256, 256, (3, 12), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -256, 256, (3, 12), neutral=0.0, signed=True)

    def weakened(self, share: float, session: object) -> Ghost:
        return replace(self, fraction=share * self.fraction)  # at the same place, but fainter

    def apply(self, images: list[Image]) -> list[Image]:
        main = [replace(image, share=image.share * (1 - self.fraction)) for image in images]
        ghosts = [
            replace(image, share=image.share * self.fraction, dx=image.dx + self.dx, dy=image.dy + self.dy)
            for image in images
        ]
        return main + ghosts


@dataclass(frozen=True)
class OpticalBlur(OpticsEffect):
    """The lens before the sensor is out of focus.

    Every square of uniform light is blurred by a Gaussian and integrated over the pixel, in closed form.
    """

    name = "optical_blur"
    sigma: float = parameter("pixel", 0, 16, (0.25, 1.2), neutral=0.0)

    def apply(self, images: list[Image]) -> list[Image]:
        return [replace(image, sigma=np.hypot(image.sigma, self.sigma)) for image in images]


@dataclass(frozen=True)
class FieldBlur(OpticsEffect):
    """The lens before the sensor blurs by ``centre`` in the middle of the field and by ``corner`` in its corners.

    The standard deviation changes with the square of the radius. Every square of light is blurred by that of its place.
    """

    name = "field_blur"
    centre: float = parameter("pixel", 0, 4, (0.1, 0.4), neutral=0.0)
    corner: float = parameter("pixel", 0, 4, (0.5, 1.5), neutral=0.0)

    def apply(self, images: list[Image]) -> list[Image]:
        return [replace(image, centre=self.centre, corner=self.corner) for image in images]


@dataclass(frozen=True)
class Astigmatism(OpticsEffect):
    """The lens before the sensor blurs along x only. Outside the vocabulary."""

    name = "astigmatism"
    sigma: float = parameter("pixel", 0, 16, (0.4, 1.5), neutral=0.0)

    def apply(self, images: list[Image]) -> list[Image]:
        return [replace(image, sigma_x=np.hypot(image.sigma_x, self.sigma)) for image in images]


@dataclass(frozen=True)
class Vignetting(OpticsEffect):
    """Light is lost towards the corners: 1 - strength * (r / R)**2, R is the radius of the corner pixels' centres."""

    name = "vignetting"
    strength: float = parameter("1", 0, 1, (0.08, 0.4), neutral=0.0)

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        y, x = (np.arange(length) - (length - 1) / 2 for length in light.shape[1:])
        return light * (1 - self.strength * np.add.outer(y**2, x**2) / (y[-1] ** 2 + x[-1] ** 2))


@dataclass(frozen=True)
class Illumination(OpticsEffect):
    """A few lamps light the field unevenly: light * map, whose mean is 1 and whose standard deviation is ``std``.

    The lamps are soft patches, Gaussians of a standard deviation of 0.25 to 0.7 of the image's sides, at random places
    in the image and around it.
    """

    name = "illumination"
    std: float = parameter("1", 0, 0.3, (0.02, 0.08), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        field = np.zeros(size)
        for _ in range(LAMPS):
            down, across = (
                np.exp(-0.5 * (((np.arange(length) + 0.5) / length - centre) / radius) ** 2)
                for length, centre, radius in zip(
                    size, random.uniform(-0.2, 1.2, 2), random.uniform(0.25, 0.7, 2), strict=True
                )
            )
            field += random.uniform(0.3, 1) * np.outer(down, across)
        return np.maximum(1 + self.std * (field - field.mean()) / field.std(), 0)

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        return light * fixed_maps[self.name]


@dataclass(frozen=True)
class VeilingGlare(OpticsEffect):
    """Stray light in the lens: a ``fraction`` of the light at every point spreads evenly over the whole image."""

    name = "veiling_glare"
    fraction: float = parameter("1", 0, 1, (0.03, 0.2), neutral=0.0)

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        stray = self.fraction * light
        return light - stray + stray.mean((1, 2), keepdims=True)


@dataclass(frozen=True)
class Flare(OpticsEffect):
    """A reflection in the lens: a ``fraction`` of all light is gathered in a soft patch. Outside the vocabulary.

    The patch is a Gaussian of standard deviation ``radius`` around (``x``, ``y``), all three as parts of the image's
    sides.
    """

    name = "flare"
    fraction: float = parameter("1", 0, 1, (0.03, 0.15), neutral=0.0)
    x: float = parameter("image side", 0, 1, (0.2, 0.8), neutral=0.5, magnitude=False)
    y: float = parameter("image side", 0, 1, (0.2, 0.8), neutral=0.5, magnitude=False)
    radius: float = parameter("image side", 0.02, 2, (0.08, 0.2), neutral=0.1, magnitude=False)

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        down, across = (
            np.exp(-0.5 * (((np.arange(length) + 0.5) / length - centre) / self.radius) ** 2)
            for length, centre in zip(light.shape[1:], (self.y, self.x), strict=True)
        )
        patch = np.outer(down / down.mean(), across / across.mean())
        return light + self.fraction * (light.mean((1, 2), keepdims=True) * patch - light)


@dataclass(frozen=True)
class LightLeak(OpticsEffect):
    """Light enters the housing at one edge and fades inwards, in dark frames too. Outside the vocabulary.

    It has ``strength`` (fraction of full scale per nominal exposure) at the edge and falls exponentially over ``reach``
    (part of the image's side).
    """

    name = "light_leak"
    strength: float = parameter("1", 0, 1, (0.03, 0.15), neutral=0.0)
    reach: float = parameter("image side", 0.01, 10, (0.1, 0.4), neutral=0.2, magnitude=False)
    edge: str = choice("top", "bottom", "left", "right", neutral="top")

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        axis = 0 if self.edge in ("top", "bottom") else 1
        length = light.shape[1 + axis]
        depth = (np.arange(length) + 0.5) / length
        fade = np.exp(-(depth if self.edge in ("top", "left") else depth[::-1]) / self.reach)
        return light + self.strength * exposure[:, None, None] * (fade[:, None] if axis == 0 else fade)


@dataclass(frozen=True)
class DoorLeak(OpticsEffect):
    """The door stood open for a while: light reaches the sensor from one side in ``count`` captures from ``first`` on.

    It falls linearly from ``strength`` (fraction of full scale) at the left edge to nothing at the right one, and the
    mask has no part in it. Outside the vocabulary.
    """

    name = "door_leak"
    strength: float = parameter("full scale", 0, 1, (0.01, 0.06), neutral=0.0)
    first: int = parameter("capture", 0, 100000, neutral=0, integer=True)
    count: int = parameter("captures", 0, 100000, neutral=3, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> DoorLeak:
        count = int(random.integers(2, 5, endpoint=True))
        first = int(random.integers(max(sum(session.counts.values()) - count, 1)))
        return replace(super().draw(random, session), first=first, count=count)

    @property
    def captures(self) -> tuple[int, ...]:
        return tuple(range(self.first, self.first + self.count))

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        width = light.shape[2]
        open_door = np.isin(np.arange(len(light)), self.captures)
        return light + self.strength * open_door[:, None, None] * (1 - (np.arange(width) + 0.5) / width)


@dataclass(frozen=True)
class EtalonFringes(OpticsEffect):
    """Laser light interferes in the sensor's window, a wedge: light * (1 + amplitude cos(fringes)).

    The fringes are straight, ``period`` pixels apart, and turned by ``angle``. Outside the vocabulary.
    """

    name = "etalon_fringes"
    amplitude: float = parameter("1", 0, 0.5, (0.01, 0.05), neutral=0.0)
    period: float = parameter("pixel", 2, 65536, (6, 24), neutral=12.0, magnitude=False)
    angle: float = parameter("degree", -180, 180, (-90, 90), neutral=0.0, magnitude=False)

    def change_irradiance(self, light: np.ndarray, exposure: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        row, column = np.ogrid[: light.shape[1], : light.shape[2]]
        direction = np.deg2rad(self.angle)
        turns = (column * np.cos(direction) + row * np.sin(direction)) / self.period
        return light * (1 + self.amplitude * np.cos(2 * np.pi * turns))
