"""How a mask of another size than the snapshot may fit it: as one pattern that moves, or as a crop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import uniform_filter

from sci_lightning.encoder.mask.shifting import moved_pattern
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import doubtful_axes, read_mask_file
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.stored_array import readable_shape

FINE = 7
"""Side in pixels of the mean that is subtracted: what is finer is the mask's, what is coarser the scene's."""
CERTAIN = 10.0
"""Standard deviations by which the best place must stand out from all others."""
LEAST_COMMON = 0.5
"""Part of the smaller side that mask and snapshot must have in common."""
MOST_NAMED = 6
"""Steps that a message lists."""


class SnapshotMask(NamedTuple):
    """A mask as it lies on snapshots.

    Attributes:
        patterns: float32 ``(T, H, W)``.
        rows, columns: the part of the snapshots that the mask covers, H x W pixels.
    """

    patterns: np.ndarray
    rows: slice
    columns: slice


def mask_of_snapshots(
    file: str | Path,
    snapshots: np.ndarray,
    *,
    key: str | None = None,
    step: Sequence[float] | None = None,
    origin: Sequence[int] | None = None,
    slots: int | None = None,
    levels: tuple[float | None, float | None] = (None, None),
) -> SnapshotMask:
    """Read a mask and lay it on snapshots.

    Args:
        file: file or folder of ``(T, h, w)`` (MATLAB's ``(h, w, T)`` in a .mat), or of one pattern ``(h, w)`` that
            moves, see :func:`~sci_lightning.files.mask_file.read_mask_file`.
        snapshots: ``(N, H, W)``, linear in the light.
        key: name of the mask's array; None for ``mask``, or the only one that fits.
        step: (rows, columns) by which one pattern moves from slot to slot, +down and +right; part pixels as well.
        origin: (row, column) of the mask at which the snapshots begin, those of the first slot where it moves; negative
            where the snapshots begin earlier. None: at the mask's edge. Of several patterns only what snapshots and
            mask both have is used; beyond one that moves it is dark.
        slots: T. None: as many as the file has, or as the step leads from edge to edge. Of a file with more patterns
            the first so many are used.
        levels: numbers in the file that are transmittance 0 and 1, see
            :func:`~sci_lightning.files.mask_file.transmittance`.

    Raises:
        BadInput: the mask cannot be read or does not fit; the message says which shift or crop would fit, if one does.
    """
    dark, white = levels
    patterns = read_mask_file(
        file,
        key,
        one_pattern=True,
        setting="mask_key",
        field=snapshots.shape[1:],
        frames=slots,
        dark=dark,
        white=white,
    ).astype(np.float32)
    if not patterns.any():
        raise BadInput(
            f"{file}: the mask never opens, it is dark: every value is 0; give the mask that the snapshots were taken "
            "with"
        )
    field = snapshots.shape[1:]
    if patterns.ndim == 2:
        patterns = _moving(patterns, field, file, step, origin, slots)
        return SnapshotMask(patterns, slice(0, field[0]), slice(0, field[1]))
    if step is not None:
        raise BadInput(f"mask_step={list(step)}: {file} has {len(patterns)} patterns; one that moves is (H, W)")
    if slots is not None and not 2 <= slots <= len(patterns):
        raise BadInput(f"mask_slots={slots}: {file} has {len(patterns)} patterns; expected 2 to {len(patterns)}")
    patterns = patterns[:slots]
    if origin is None and patterns.shape[1:] != field:
        raise BadInput(f"{file}: {_advice(patterns, snapshots)}")
    return _overlap(patterns, field, (0, 0) if origin is None else origin)


def moving_masks(
    pattern: np.ndarray,
    field: Sequence[int],
    step: Sequence[float],
    origin: Sequence[int] | None = None,
    slots: int | None = None,
) -> np.ndarray | None:
    """Return the patterns of one pattern that moves over the field from slot to slot; the arguments are those above.

    Returns:
        float32 ``(T, H, W)``; None if T is not given, and no whole number of steps, 1 or more, leads from edge to edge.
    """
    if slots is None:
        free = [abs(whole - own) for whole, own in zip(field, pattern.shape, strict=True)]
        counts = {space / abs(one) for space, one in zip(free, step, strict=True) if one}
        still = all(space == 0 for space, one in zip(free, step, strict=True) if not one)
        if len(counts) != 1 or not still or (steps := counts.pop()) < 1 or steps != int(steps):
            return None
        slots = int(steps) + 1
    return moved_pattern(torch.from_numpy(pattern), slots, field, step, origin).numpy()


def sizes_of_steps(size: Sequence[int], field: Sequence[int]) -> str:
    """Say by which steps a pattern of ``size`` (h, w) could move over the ``field`` (H, W) of the snapshots."""
    rows, columns = (abs(whole - own) for whole, own in zip(field, size, strict=True))
    if (rows > 0) == (columns > 0):
        return (
            f"the snapshots are {field[0]} x {field[1]}, and no pattern of that size moves along an axis from edge to "
            "edge; give one pattern for every slot, T x H x W, or of one that moves 'mask_step=[ROWS,COLUMNS]' "
            "mask_slots=T"
        )
    space, axis = (rows, 0) if rows else (columns, 1)
    steps = [one for one in range(1, space + 1) if space % one == 0][:MOST_NAMED]
    likely = 2 if 2 in steps else steps[0]
    listed = ", ".join(f"{one} with {space // one + 1} slots" for one in steps)
    example = [0, 0]
    example[axis] = likely
    return (
        f"the snapshots are {field[0]} x {field[1]}, {space} {'columns' if axis else 'rows'} "
        f"{'more' if sum(field) > sum(size) else 'fewer'}: a mask that moves "
        f"from slot to slot fits, by {listed} pixels; give 'mask_step=[{example[0]},{example[1]}]' or another"
    )


def origin_in_mask(patterns: np.ndarray, dn: np.ndarray) -> tuple[tuple[int, int], float] | None:
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
    peak = np.unravel_index(correlation.argmax(), correlation.shape)
    others = correlation[common > least]
    if correlation[peak] < CERTAIN * others.std():
        return None
    top, left = (int(at) - (side - 1) for at, side in zip(peak, snapshot.shape, strict=True))
    return (top, left), float(correlation[peak] / np.sqrt(common[peak]))


def _moving(
    pattern: np.ndarray,
    field: Sequence[int],
    file: str | Path,
    step: Sequence[float] | None,
    origin: Sequence[int] | None,
    slots: int | None,
) -> np.ndarray:
    """Return the patterns ``(T, H, W)`` of one pattern ``(h, w)`` that moves over the field from slot to slot."""
    if step is None:
        raise BadInput(
            f"{file}: one pattern of {readable_shape(pattern.shape)} pixels; {sizes_of_steps(pattern.shape, field)}"
        )
    if not any(step):
        raise BadInput(f"mask_step={list(step)}: all slots would be equal; give a step other than [0,0]")
    if slots is not None:
        check_memory(f"mask_slots={slots} of {readable_shape(field)} pixels", 12 * slots * field[0] * field[1])
    if (patterns := moving_masks(pattern, field, step, origin, slots)) is None:
        raise BadInput(
            f"mask_step={list(step)}: a pattern of {readable_shape(pattern.shape)} that moves by so much does not end "
            f"at the edge of {readable_shape(field)} pixels; {sizes_of_steps(pattern.shape, field)}; mask_slots=T says "
            "how many slots there are"
        )
    if not patterns.any((1, 2)).all():
        raise BadInput(
            f"mask_step={list(step)}: the pattern of {readable_shape(pattern.shape)} leaves the field of "
            f"{readable_shape(field)} pixels before slot {len(patterns)}; give a smaller step, fewer mask_slots= or "
            "another mask_origin="
        )
    return patterns


def _advice(patterns: np.ndarray, snapshots: np.ndarray) -> str:
    """Say what is wrong with the size of a mask, and which crop would fit, if one does."""
    field = snapshots.shape[1:]
    wrong = (
        f"the mask is {readable_shape(patterns.shape)} (T x H x W), the snapshots are {readable_shape(field)} pixels"
    )
    if question := doubtful_axes(patterns.shape, field):
        return f"{wrong}; {question}"
    best = origin_in_mask(patterns, snapshots)
    if best is None:
        return f"{wrong}, and no part of the one fits the other; give the mask that the snapshots were taken with"
    (top, left), correlation = best
    # Sides of equal length begin together: by how much the image is displaced along them is the diagnosis's question.
    top, left = (
        0 if mask_side == side else at
        for at, mask_side, side in zip((top, left), patterns.shape[1:], field, strict=True)
    )
    return (
        f"{wrong}; they fit if the snapshots begin at row {top}, column {left} of the mask (correlation "
        f"{correlation:.2f}): add 'mask_origin=[{top},{left}]'"
    )


def _overlap(patterns: np.ndarray, field: Sequence[int], origin: Sequence[int]) -> SnapshotMask:
    """Return what mask and snapshots both have, when the snapshots begin at ``origin`` of the mask."""
    parts = []
    for first, mask_side, side in zip(origin, patterns.shape[1:], field, strict=True):
        start, stop = max(0, int(first)), min(mask_side, int(first) + side)
        if stop - start < 16:
            raise BadInput(
                f"mask_origin={list(origin)}: mask {readable_shape(patterns.shape[1:])} and snapshots "
                f"{readable_shape(field)} have fewer than 16 pixels in common"
            )
        parts.append((slice(start, stop), slice(start - int(first), stop - int(first))))
    (rows, own_rows), (columns, own_columns) = parts
    return SnapshotMask(patterns[:, rows, columns], own_rows, own_columns)


def _fine(image: np.ndarray) -> np.ndarray:
    """Return the structure finer than :data:`FINE` pixels, relative to the local brightness, without outliers."""
    local = uniform_filter(image, FINE)
    fine = (image - local) / np.maximum(local, 0.1 * image.mean() + 1e-9)
    return np.asarray(np.clip(fine, -3, 3))
