"""Random numbers: an independent stream for every purpose, and random maps that belong to one device."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Return a generator for one purpose whose numbers are independent of those for every other purpose.

    Hiding an effect therefore changes neither the patterns nor the scenes of a seed, and two cameras can be compared
    with the same input.
    """
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def standard_normal(random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return Gaussian numbers whose sample mean is exactly 0 and whose sample standard deviation is exactly 1.

    A fixed-pattern map made of them has exactly the standard deviation that its effect states: the map is that of this
    one camera, not of the batch the camera comes from, and its mean is neither a gain nor a black level.
    """
    numbers = random.standard_normal(shape)
    return (numbers - numbers.mean()) / numbers.std()


def dust_spots(random: np.random.Generator, size: tuple[int, int], count: int, radius: float) -> np.ndarray:
    """Return the opacity of ``count`` grains of dust that are out of focus, at random places.

    Args:
        random: source of the places and of the grains' own sizes.
        size: (H, W).
        count: number of grains.
        radius: typical radius of a grain, pixel; a grain's own radius lies within 30 % of it.

    Returns:
        (H, W) in [0, 1], 1 in the middle of a grain.
    """
    row, column = np.indices(size)
    clear = np.ones(size)
    for _ in range(count):
        y, x = random.uniform(0, 1, 2) * size
        own_radius = radius * random.uniform(0.7, 1.3)
        clear *= 1 - np.exp(-((np.hypot(row + 0.5 - y, column + 0.5 - x) / own_radius) ** 4))
    return 1 - clear
