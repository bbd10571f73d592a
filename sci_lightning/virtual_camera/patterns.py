"""Coding patterns for the modulator: random ones, or those of a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import read_mask_file


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
