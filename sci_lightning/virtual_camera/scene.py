"""What is put before the camera and on its modulator: textured scenes, and coding patterns, random or of a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import read_mask_file

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


def structural(random: np.random.Generator, frames: int, size: tuple[int, int], bits: int) -> np.ndarray:
    """Return random levels that sum to 1 over time at every pixel.

    The levels of a pixel are a composition of L = 2**bits units of light into T parts, all compositions equally likely
    (stars and bars). Where all units fall into one slot, one of them is moved to the next slot.

    Args:
        random: source of the levels.
        frames: T, number of slots.
        size: (H, W).
        bits: bit depth of the levels.

    Returns:
        (T, H, W) in {0, 1/L, .., 1 - 1/L}; with 1 bit in {0, 1}.
    """
    height, width = size
    if bits == 1:
        return np.eye(frames)[random.integers(frames, size=size)].transpose(2, 0, 1)
    levels = 2**bits
    places = random.random((height * width, levels + frames - 1)).argpartition(frames - 2, axis=1)[:, : frames - 1]
    bars = np.sort(places, axis=1)
    ends = np.full((len(bars), 1), levels + frames - 1)
    units = np.diff(np.concatenate((np.full_like(ends, -1), bars, ends), axis=1), axis=1) - 1
    alone = (units == levels).astype(int)
    units += np.roll(alone, 1, axis=1) - alone
    return units.T.reshape(frames, height, width) / levels


def binary(random: np.random.Generator, frames: int, size: tuple[int, int]) -> np.ndarray:
    """Return patterns (T, H, W) in which every mirror is on (1) or off (0) in every slot with probability 1/2."""
    return random.integers(0, 2, (frames, *size)).astype(np.float64)


def read_patterns(path: str | Path, frames: int, size: tuple[int, int]) -> np.ndarray:
    """Read coding patterns (T, H, W) in [0, 1] from a file, see :func:`~sci_lightning.files.mask_file.read_mask_file`.

    Raises:
        BadInput: no such file, not readable, or another shape or range.
    """
    expected = f"{frames} patterns of {size[0]} x {size[1]} (frames and size), values in [0, 1]"
    try:
        patterns = read_mask_file(path, field=size, frames=frames)
    except BadInput as error:
        raise BadInput(f"mask={error}; mask is structural, binary or a file of {expected}") from error
    if patterns.shape != (frames, *size):
        raise BadInput(f"mask={path}: holds {patterns.dtype} {patterns.shape}, expected {expected}")
    return patterns.astype(np.float64)
