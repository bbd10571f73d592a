"""Textured scenes in front of the camera: photographs and speckle, at rest or in motion."""

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
"""Files of the installed scikit-image; nothing is downloaded."""
LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in the luma of ITU-R BT.601."""


def textured_scene(
    random: np.random.Generator, size: tuple[int, int], frames: int, *, moving: bool, border: int = 0
) -> np.ndarray:
    """Return a scene with detail everywhere that uses most of the range [0, 1].

    It is a photograph with probability 2/3, else speckle, turned and magnified at random. A moving scene shifts by 0.3
    to 3 pixels and turns by up to 0.03 radian per slot; the frame of a slot is the scene at the middle of the slot.

    Args:
        random: source of the texture and its motion.
        size: (H, W).
        frames: T.
        moving: whether the scene moves.
        border: B, pixels of the scene beyond the field on each side.

    Returns:
        (T, H + 2 B, W + 2 B) float32 irradiance; the field in its middle does not depend on the border.
    """
    if random.random() < 2 / 3:
        texture, step = _photograph(random), float(random.uniform(0.8, 2.5))
    else:
        texture, step = _speckle(random), 1.0
    time = np.arange(frames) + 0.5 if moving else np.zeros(frames)
    direction, speed = random.uniform(0, 2 * np.pi), random.uniform(0.3, 3)
    start = np.array(texture.shape) * random.uniform(0.3, 0.7, 2)
    centre = start + step * speed * time[:, None] * np.array([np.sin(direction), np.cos(direction)])
    angle = random.uniform(0, 2 * np.pi) + random.uniform(-0.03, 0.03) * time
    height, width = size
    whole = (height + 2 * border, width + 2 * border)
    scene = _sampled(gaussian_filter(texture, 0.4 * step), whole, centre, angle, step)
    field = scene[:, border : border + height, border : border + width]
    dark, bright = np.percentile(field, (1, 99))
    scene = (scene - dark) / max(bright - dark, 1e-3)
    return np.clip(scene * random.uniform(0.8, 1), 0, 1).astype(np.float32)


def _sampled(
    texture: np.ndarray, size: tuple[int, int], centre: np.ndarray, angle: np.ndarray, step: float
) -> np.ndarray:
    """Return (T, H, W): the texture around ``centre`` (T, 2), turned by ``angle`` (T,), sampled every ``step`` px."""
    y, x = (step * (np.indices(size)[axis] - (length - 1) / 2) for axis, length in enumerate(size))
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    row, column = centre.T[:, :, None, None]
    return map_coordinates(texture, [row + cos * y + sin * x, column + cos * x - sin * y], order=1, mode="mirror")


def _photograph(random: np.random.Generator) -> np.ndarray:
    """Return a random one of the photographs in shades of gray, in [0, 1]."""
    import skimage
    from skimage.io import imread

    file = Path(skimage.__file__).parent / "data" / str(random.choice(PHOTOGRAPHS))
    try:
        picture = imread(file) / 255.0
    except OSError as error:
        raise BadInput(f"{file}: missing; reinstall scikit-image, which brings it") from error
    return picture if picture.ndim == 2 else picture[:, :, :3] @ LUMA


def _speckle(random: np.random.Generator) -> np.ndarray:
    """Return blurred noise with grains of 1 to 3 pixels."""
    return gaussian_filter(random.random((384, 384)), random.uniform(1, 3), mode="wrap")
