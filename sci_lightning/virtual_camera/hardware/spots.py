"""Dust: soft spots at random places."""

from __future__ import annotations

import numpy as np


def spots(random: np.random.Generator, size: tuple[int, int], count: int, radius: float) -> np.ndarray:
    """(H, W) in [0, 1]: ``count`` discs of about ``radius`` (pixel), out of focus; 1 in the middle of a grain."""
    row, column = np.indices(size)
    clear = np.ones(size)
    for _ in range(count):
        y, x = random.uniform(0, 1, 2) * size
        own = radius * random.uniform(0.7, 1.3)
        clear *= 1 - np.exp(-((np.hypot(row + 0.5 - y, column + 0.5 - x) / own) ** 4))
    return 1 - clear
