"""Targets before the camera: photographs and speckle, at rest or on the move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from sci_lightning.errors import BadInput

PHOTOGRAPHS = (
    "astronaut.png",
    "brick.png",
    "camera.png",
    "chelsea.png",
    "coffee.png",
    "coins.png",
    "grass.png",
    "gravel.png",
    "moon.png",
    "motorcycle_left.png",
    "page.png",
    "rocket.jpg",
    "text.png",
)
"""Inside the installed scikit-image (nothing is downloaded)."""
LUMA = (0.299, 0.587, 0.114)


def textured_scene(random: np.random.Generator, size: tuple[int, int], frames: int, *, moving: bool) -> np.ndarray:
    """A target with detail everywhere: float32 (T, H, W) irradiance that uses most of [0, 1].

    Two times in three a photograph, else speckle; turned and magnified at random. When moving it glides by 0.3 to 3
    pixels and turns by up to 0.03 radian a slot; the frame of a slot is what the scene is at its middle.
    """
    if random.random() < 2 / 3:
        texture, step = _photograph(random), float(random.uniform(0.8, 2.5))
    else:
        texture, step = _speckle(random), 1.0
    time = np.arange(frames) + 0.5 if moving else np.zeros(frames)
    course, speed = random.uniform(0, 2 * np.pi), random.uniform(0.3, 3)
    start = np.array(texture.shape) * random.uniform(0.3, 0.7, 2)
    centre = start + step * speed * time[:, None] * np.array([np.sin(course), np.cos(course)])
    angle = random.uniform(0, 2 * np.pi) + random.uniform(-0.03, 0.03) * time
    scene = _look(gaussian_filter(texture, 0.4 * step), size, centre, angle, step)
    dark, bright = np.percentile(scene, (1, 99))
    scene = (scene - dark) / max(bright - dark, 1e-3)
    return np.clip(scene * random.uniform(0.8, 1), 0, 1).astype(np.float32)


def _look(texture: np.ndarray, size: tuple[int, int], centre: np.ndarray, angle: np.ndarray, step: float) -> np.ndarray:
    """(T, H, W): the texture around ``centre`` (T, 2), turned by ``angle`` (T,), a sample every ``step`` pixels."""
    y, x = (step * (np.indices(size)[axis] - (length - 1) / 2) for axis, length in enumerate(size))
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    row, column = centre.T[:, :, None, None]
    return map_coordinates(texture, [row + cos * y + sin * x, column + cos * x - sin * y], order=1, mode="mirror")


def _photograph(random: np.random.Generator) -> np.ndarray:
    import skimage
    from skimage.io import imread

    file = Path(skimage.__file__).parent / "data" / str(random.choice(PHOTOGRAPHS))
    try:
        picture = imread(file) / 255.0
    except OSError as error:
        raise BadInput(f"{file}: missing; reinstall scikit-image, which brings it") from error
    return picture if picture.ndim == 2 else picture[:, :, :3] @ LUMA


def _speckle(random: np.random.Generator) -> np.ndarray:
    """Blurred noise with grains of 1 to 3 pixels."""
    return gaussian_filter(random.random((384, 384)), random.uniform(1, 3), mode="wrap")
