"""The optics: modulated light on its way to the pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.overlap import overlap, sources_with
from sci_lightning.virtual_camera.hardware.parameter import choice, parameter


@dataclass(frozen=True)
class Image:
    """One of the images that the lens forms of the modulated light.

    Attributes:
        share: of the light. dx, dy: where it lies, pixel. sigma: of its Gaussian blur, pixel.
        across: of a further blur, along x only, pixel.
    """

    share: float = 1.0
    dx: float = 0.0
    dy: float = 0.0
    sigma: float = 0.0
    across: float = 0.0

    def collect(self, light: np.ndarray, rows: np.ndarray, columns: np.ndarray, surround: str) -> np.ndarray:
        """(H, W): what each pixel gets of light (n, m) that is even over cells: blurred and integrated, exactly."""
        down, across = (
            overlap(np.arange(cells[-1] + 1), sources_with(surround, cells + shift), sigma)
            for cells, shift, sigma in (
                (rows, self.dy, self.sigma),
                (columns, self.dx, np.hypot(self.sigma, self.across)),
            )
        )
        return self.share * (down @ light @ across.T)


@dataclass(frozen=True)
class OpticsEffect(Effect):
    """Changes the images that are formed, or the irradiance of the pixels."""

    stage: ClassVar[str] = "optics"

    def form(self, images: list[Image]) -> list[Image]:
        """The images with this fault."""
        return images

    def fall(self, light: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Irradiance (N, H, W) with this fault; ``time`` (N,) is each capture's exposure."""
        return light


@dataclass(frozen=True)
class Ghost(OpticsEffect):
    """A reflection: a ``fraction`` of the light forms a second image (dx, dy) away. Outside the vocabulary."""

    name = "ghost"
    fraction: float = parameter("1", 0, 0.5, (0.03, 0.12), neutral=0.0)
    dx: float = parameter("pixel", -256, 256, (3, 12), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -256, 256, (3, 12), neutral=0.0, signed=True)

    def weakened(self, share: float, session: object) -> Ghost:
        return replace(self, fraction=share * self.fraction)  # as far away, but fainter

    def form(self, images: list[Image]) -> list[Image]:
        main = [replace(image, share=image.share * (1 - self.fraction)) for image in images]
        ghosts = [
            replace(image, share=image.share * self.fraction, dx=image.dx + self.dx, dy=image.dy + self.dy)
            for image in images
        ]
        return main + ghosts


@dataclass(frozen=True)
class OpticalBlur(OpticsEffect):
    """The lens before the sensor is out of focus.

    Each square of even light is blurred by a Gaussian and integrated over the pixel, in closed form.
    """

    name = "optical_blur"
    sigma: float = parameter("pixel", 0, 16, (0.25, 1.2), neutral=0.0)

    def form(self, images: list[Image]) -> list[Image]:
        return [replace(image, sigma=np.hypot(image.sigma, self.sigma)) for image in images]


@dataclass(frozen=True)
class Astigmatism(OpticsEffect):
    """The lens before the sensor blurs along x and is sharp along y. Outside the vocabulary."""

    name = "astigmatism"
    sigma: float = parameter("pixel", 0, 16, (0.4, 1.5), neutral=0.0)

    def form(self, images: list[Image]) -> list[Image]:
        return [replace(image, across=np.hypot(image.across, self.sigma)) for image in images]


@dataclass(frozen=True)
class Vignetting(OpticsEffect):
    """Light lost towards the corners: 1 - strength * (r / R)**2, R at the centre of the corner pixels."""

    name = "vignetting"
    strength: float = parameter("1", 0, 1, (0.08, 0.4), neutral=0.0)

    def fall(self, light: np.ndarray, time: np.ndarray) -> np.ndarray:
        y, x = (np.arange(length) - (length - 1) / 2 for length in light.shape[1:])
        return light * (1 - self.strength * np.add.outer(y**2, x**2) / (y[-1] ** 2 + x[-1] ** 2))


@dataclass(frozen=True)
class VeilingGlare(OpticsEffect):
    """Stray light inside the lens: a ``fraction`` leaves every point of the image and spreads evenly over all of it."""

    name = "veiling_glare"
    fraction: float = parameter("1", 0, 1, (0.03, 0.2), neutral=0.0)

    def fall(self, light: np.ndarray, time: np.ndarray) -> np.ndarray:
        stray = self.fraction * light
        return light - stray + stray.mean((1, 2), keepdims=True)


@dataclass(frozen=True)
class Flare(OpticsEffect):
    """A reflection inside the lens: a ``fraction`` of all light gathers in a soft patch. Outside the vocabulary.

    The patch is a Gaussian of deviation ``radius`` around (``x``, ``y``), all three in image sides.
    """

    name = "flare"
    fraction: float = parameter("1", 0, 1, (0.03, 0.15), neutral=0.0)
    x: float = parameter("image side", 0, 1, (0.2, 0.8), neutral=0.5, magnitude=False)
    y: float = parameter("image side", 0, 1, (0.2, 0.8), neutral=0.5, magnitude=False)
    radius: float = parameter("image side", 0.02, 2, (0.08, 0.2), neutral=0.1, magnitude=False)

    def fall(self, light: np.ndarray, time: np.ndarray) -> np.ndarray:
        down, across = (
            np.exp(-0.5 * (((np.arange(length) + 0.5) / length - middle) / self.radius) ** 2)
            for length, middle in zip(light.shape[1:], (self.y, self.x), strict=True)
        )
        patch = np.outer(down / down.mean(), across / across.mean())
        return light + self.fraction * (light.mean((1, 2), keepdims=True) * patch - light)


@dataclass(frozen=True)
class LightLeak(OpticsEffect):
    """Light enters the housing at one edge and fades inwards, in dark frames too. Outside the vocabulary.

    ``strength`` (fraction of full scale per nominal exposure) at the edge, falling exponentially over ``reach`` (of the
    image's side).
    """

    name = "light_leak"
    strength: float = parameter("1", 0, 1, (0.03, 0.15), neutral=0.0)
    reach: float = parameter("image side", 0.01, 10, (0.1, 0.4), neutral=0.2, magnitude=False)
    edge: str = choice("top", "bottom", "left", "right", neutral="top")

    def fall(self, light: np.ndarray, time: np.ndarray) -> np.ndarray:
        axis = 0 if self.edge in ("top", "bottom") else 1
        length = light.shape[1 + axis]
        depth = (np.arange(length) + 0.5) / length
        fade = np.exp(-(depth if self.edge in ("top", "left") else depth[::-1]) / self.reach)
        return light + self.strength * time[:, None, None] * (fade[:, None] if axis == 0 else fade)
