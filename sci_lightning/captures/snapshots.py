"""Captures of unknown scenes from files as people have them: a few snapshots and the mask of some day."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.mask_fit import moving_masks, place_of_mask, sizes_of_steps
from sci_lightning.captures.raw_dn import raw_dn, step_of
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import doubtful_axes, read_mask_file
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.packed_file import RawLayout
from sci_lightning.files.picture_file import read_pictures
from sci_lightning.files.stored_array import readable_shape


def read_snapshots(
    files: Sequence[str | Path],
    key: str | None = None,
    bit_depth: int | None = None,
    raw: RawLayout | None = None,
) -> tuple[np.ndarray, int]:
    """Read snapshots of one camera.

    Args:
        files: TIFF, PNG, MAT, NPY or HDF5, one or more snapshots each, all of one size.
        key: name of the array in a MAT or HDF5 file; None for ``meas``, or the only one that fits.
        bit_depth: of the camera; None for the smallest usual one that holds all values.
        raw: what files of raw numbers do not say of themselves; its bits are the bit depth unless that is given.

    Returns:
        raw DN, uint16 ``(N, H, W)``, and the bit depth.

    Raises:
        BadInput: no file, one that cannot be read, other sizes, or values that are no DN.
    """
    if not files:
        raise BadInput("measurement: no file is named; give measurement=FILE or 'measurement=[FILE,FILE]'")
    bit_depth = raw.bits if raw is not None and bit_depth is None else bit_depth
    images: list[np.ndarray] = []
    depths: list[int] = []
    fractions: list[bool] = []
    for file in files:
        values = read_pictures(file, prefer="meas", key=key, setting="key", raw=raw)
        dn, bits = raw_dn(values if values.ndim == 3 else values[None], str(file), bit_depth)
        if not dn.any():
            raise BadInput(
                f"{file}: the snapshot is black: every value is 0; is the array the right one, the lens open?"
            )
        if images and dn.shape[1:] != images[0].shape[1:]:
            first, size = readable_shape(images[0].shape[1:]), readable_shape(dn.shape[1:])
            raise BadInput(f"{file}: {size} pixels, the first file has {first}")
        fractions.append(values.dtype.kind == "f" and float(values.max()) <= 1 and step_of(values) is None)
        if fractions[-1] != fractions[0]:
            units = ("fractions of full scale", "DN") if fractions[-1] else ("DN", "fractions of full scale")
            raise BadInput(f"{file}: {units[0]}, the first file has {units[1]}; give all in the same unit")
        images.append(dn)
        depths.append(bits)
        check_memory(f"{file} with those before it", 3 * sum(image.nbytes for image in images))
    return np.concatenate(images), max(depths)


def captures_of_snapshots(
    dn: np.ndarray,
    bit_depth: int,
    mask: str | Path,
    *,
    key: str | None = None,
    levels: tuple[float | None, float | None] = (None, None),
    step: Sequence[int] | None = None,
    origin: Sequence[int] | None = None,
    verification: Sequence[int] | None = None,
    name: str = "",
) -> Captures:
    """Return snapshots of unknown scenes with their mask as captures.

    Args:
        dn: raw DN ``(N, H, W)``.
        bit_depth: of the camera.
        mask: file or folder of ``(T, h, w)`` (MATLAB's ``(h, w, T)`` in a .mat), or of one pattern ``(h, w)``, see
            :func:`~sci_lightning.files.mask_file.read_mask_file`.
        key: name of the mask's array; None for ``mask``, or the only one that fits.
        levels: numbers in the file that are transmittance 0 and 1, see
            :func:`~sci_lightning.files.mask_file.transmittance`.
        step: (rows, columns) by which one pattern moves from slot to slot; the field has room for all its places.
        origin: (row, column) of the mask at which the snapshots begin, where their sizes differ; negative where the
            snapshots begin earlier. Only what both have is used.
        verification: numbers of snapshots that only judge a diagnosis; None lets the diagnosis choose.
        name: of the camera or the session.

    Raises:
        BadInput: the mask cannot be read or does not fit; the message says which shift or crop would fit, if one does.
    """
    patterns = read_mask_file(
        mask, key, one_pattern=True, setting="mask_key", field=dn.shape[1:], dark=levels[0], white=levels[1]
    )
    if not patterns.any():
        raise BadInput(
            f"{mask}: the mask never opens: every value is 0; give the mask that the snapshots were taken with"
        )
    if patterns.ndim == 2:
        patterns = _moving(patterns, dn.shape[1:], mask, step)
    elif step is not None:
        raise BadInput(f"mask_step={list(step)}: {mask} has {len(patterns)} patterns; one that moves is (H, W)")
    if origin is None and patterns.shape[1:] != dn.shape[1:]:
        raise BadInput(f"{mask}: {_advice(patterns, dn)}")
    patterns, dn = _overlap(patterns, dn, (0, 0) if origin is None else origin)
    count = len(dn)
    if verification is not None and any(not 0 <= number < count for number in verification):
        raise BadInput(
            f"verification={list(verification)}: there are {count} snapshots, numbered from 0 to {count - 1}"
        )
    slots = np.arange(len(patterns), dtype=np.int64)
    declared = 4 * count * len(patterns) * dn[0].size
    check_memory(
        f"{mask}: {count} snapshots of {len(patterns)} slots, {readable_shape(dn.shape[1:])} pixels,", declared
    )
    return Captures(
        patterns=np.ascontiguousarray(patterns, np.float32),
        sequence=np.tile(slots, (count, 1)),
        measurement=np.ascontiguousarray(dn),
        scene=np.broadcast_to(np.float32(np.nan), (count, len(patterns), *dn.shape[1:])),
        aperture=np.ones(count, np.float32),
        exposure=np.ones(count, np.float32),
        kind=("unknown",) * count,
        bit_depth=bit_depth,
        verification=None if verification is None else tuple(int(number) for number in verification),
        name=name,
    )


def _moving(pattern: np.ndarray, field: Sequence[int], file: str | Path, step: Sequence[int] | None) -> np.ndarray:
    """Return the patterns ``(T, H, W)`` of one pattern ``(h, w)`` that moves over the field from slot to slot."""
    if step is None:
        raise BadInput(
            f"{file}: one pattern of {readable_shape(pattern.shape)} pixels; {sizes_of_steps(pattern.shape, field)}"
        )
    if (patterns := moving_masks(pattern, field, (int(step[0]), int(step[1])))) is None:
        raise BadInput(
            f"mask_step={list(step)}: a pattern of {readable_shape(pattern.shape)} that moves by so much does not end "
            f"at the edge of {readable_shape(field)} pixels; {sizes_of_steps(pattern.shape, field)}"
        )
    return patterns


def _advice(patterns: np.ndarray, dn: np.ndarray) -> str:
    """Say what is wrong with the size of a mask, and which crop would fit, if one does."""
    field = dn.shape[1:]
    wrong = (
        f"the mask is {readable_shape(patterns.shape)} (T x H x W), the snapshots are {readable_shape(field)} pixels"
    )
    if question := doubtful_axes(patterns.shape, field):
        return f"{wrong}; {question}"
    place = place_of_mask(patterns, dn)
    if place is None:
        return f"{wrong}, and no part of the one fits the other; give the mask that the snapshots were taken with"
    (top, left), correlation = place
    # Sides of equal length begin together: by how much the image is displaced along them is the diagnosis's question.
    top, left = (
        0 if mask_side == side else at
        for at, mask_side, side in zip((top, left), patterns.shape[1:], field, strict=True)
    )
    return (
        f"{wrong}; they fit if the snapshots begin at row {top}, column {left} of the mask (correlation "
        f"{correlation:.2f}): add 'mask_origin=[{top},{left}]'"
    )


def _overlap(patterns: np.ndarray, dn: np.ndarray, origin: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return what mask and snapshots both have, when the snapshots begin at ``origin`` of the mask."""
    parts = []
    for first, mask_side, side in zip(origin, patterns.shape[1:], dn.shape[1:], strict=True):
        start, stop = max(0, int(first)), min(mask_side, int(first) + side)
        if stop - start < 16:
            raise BadInput(
                f"mask_origin={list(origin)}: mask {readable_shape(patterns.shape[1:])} and snapshots "
                f"{readable_shape(dn.shape[1:])} have fewer than 16 pixels in common"
            )
        parts.append((slice(start, stop), slice(start - int(first), stop - int(first))))
    (rows, own_rows), (columns, own_columns) = parts
    return patterns[:, rows, columns], dn[:, own_rows, own_columns]
