"""How a mask of another size than the snapshot may fit it: as one pattern that moves, or as a crop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter

FINE = 7
"""Side in pixels of the mean that is subtracted: what is finer is the mask's, what is coarser the scene's."""
CERTAIN = 10.0
"""Standard deviations by which the best place must stand out from all others."""
LEAST_COMMON = 0.5
"""Part of the smaller side that mask and snapshot must have in common."""
MOST_NAMED = 6
"""Steps that a message lists."""


def moving_masks(pattern: np.ndarray, field: Sequence[int], step: tuple[int, int]) -> np.ndarray | None:
    """Return the patterns of one pattern that moves over a dark field from slot to slot.

    Args:
        pattern: ``(h, w)``.
        field: (H, W) of the snapshots.
        step: (rows, columns) from one slot to the next, +down and +right; not (0, 0).

    Returns:
        float32 ``(T, H, W)``; None if no whole number of steps, 1 or more, leads from edge to edge of the field.
    """
    room = [whole - own for whole, own in zip(field, pattern.shape, strict=True)]
    counts = {space / abs(one) for space, one in zip(room, step, strict=True) if one}
    still = all(space == 0 for space, one in zip(room, step, strict=True) if not one)
    if len(counts) != 1 or not still or (steps := counts.pop()) < 1 or steps != int(steps):
        return None
    patterns = np.zeros((int(steps) + 1, *field), np.float32)
    starts = [space if one < 0 else 0 for space, one in zip(room, step, strict=True)]
    for slot, shown in enumerate(patterns):
        top, left = (start + slot * one for start, one in zip(starts, step, strict=True))
        shown[top : top + pattern.shape[0], left : left + pattern.shape[1]] = pattern
    return patterns


def sizes_of_steps(size: Sequence[int], field: Sequence[int]) -> str:
    """Say by which steps a pattern of ``size`` (h, w) could move over the ``field`` (H, W) of the snapshots."""
    rows, columns = (whole - own for whole, own in zip(field, size, strict=True))
    if (rows > 0) == (columns > 0) or min(rows, columns) < 0:
        return (
            f"the snapshots are {field[0]} x {field[1]}, and no pattern of that size moves along an axis from edge to "
            "edge; give one pattern for every slot, T x H x W"
        )
    space, axis = (rows, 0) if rows else (columns, 1)
    steps = [one for one in range(1, space + 1) if space % one == 0][:MOST_NAMED]
    likely = 2 if 2 in steps else steps[0]
    listed = ", ".join(f"{one} with {space // one + 1} slots" for one in steps)
    example = [0, 0]
    example[axis] = likely
    return (
        f"the snapshots are {field[0]} x {field[1]}, {space} {'columns' if axis else 'rows'} more: a mask that moves "
        f"from slot to slot fits, by {listed} pixels; give 'mask_step=[{example[0]},{example[1]}]' or another"
    )


def place_of_mask(patterns: np.ndarray, dn: np.ndarray) -> tuple[tuple[int, int], float] | None:
    """Return where in a mask of another size the snapshots begin, by the imprint of the mask on them.

    What is brighter than its surroundings in a snapshot has mostly been open for longer. The fine structure of the
    snapshots, each divided by its local brightness, is correlated with that of the mask's sum over time at every place.

    Args:
        patterns: ``(T, h, w)``.
        dn: ``(N, H, W)`` raw DN.

    Returns:
        (row, column) of the mask, negative where the snapshots begin before it, and the correlation there; None where
        no place stands out.
    """
    from scipy.signal import fftconvolve  # half a second to import

    mask = _fine(patterns.sum(0).astype(np.float64))
    snapshot = np.mean([_fine(image.astype(np.float64)) for image in dn], 0)
    if mask.std() == 0 or snapshot.std() == 0:
        return None
    product = fftconvolve(mask, snapshot[::-1, ::-1], mode="full")
    common = fftconvolve(np.ones(mask.shape), np.ones(snapshot.shape), mode="full")
    least = LEAST_COMMON**2 * min(mask.size, snapshot.size)
    correlation = np.where(common > least, product / np.sqrt(np.maximum(common, 1)), 0) / (mask.std() * snapshot.std())
    place = np.unravel_index(correlation.argmax(), correlation.shape)
    others = correlation[common > least]
    if correlation[place] < CERTAIN * others.std():
        return None
    top, left = (int(at) - (side - 1) for at, side in zip(place, snapshot.shape, strict=True))
    return (top, left), float(correlation[place] / np.sqrt(common[place]))


def _fine(image: np.ndarray) -> np.ndarray:
    """Return the structure finer than :data:`FINE` pixels, relative to the local brightness, without outliers."""
    local = uniform_filter(image, FINE)
    fine = (image - local) / np.maximum(local, 0.1 * image.mean() + 1e-9)
    return np.asarray(np.clip(fine, -3, 3))
