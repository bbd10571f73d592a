"""Captures of unknown scenes from files as people have them: a few snapshots and the mask of some day."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.mask_fit import mask_of_snapshots
from sci_lightning.captures.raw_dn import raw_dn, step_of
from sci_lightning.errors import BadInput
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
    step: Sequence[float] | None = None,
    origin: Sequence[int] | None = None,
    slots: int | None = None,
    verification: Sequence[int] | None = None,
    name: str = "",
) -> Captures:
    """Return snapshots of unknown scenes with their mask as captures.

    Args:
        dn: raw DN ``(N, H, W)``.
        bit_depth: of the camera.
        mask, key, levels, step, origin, slots: see :func:`~sci_lightning.captures.mask_fit.mask_of_snapshots`.
        verification: numbers of snapshots that only judge a diagnosis; None lets the diagnosis choose.
        name: of the camera or the session.

    Raises:
        BadInput: the mask cannot be read or does not fit; the message says which shift or crop would fit, if one does.
    """
    patterns, rows, columns = mask_of_snapshots(mask, dn, key=key, step=step, origin=origin, slots=slots, levels=levels)
    dn = dn[:, rows, columns]
    count = len(dn)
    if verification is not None and any(not 0 <= number < count for number in verification):
        raise BadInput(
            f"verification={list(verification)}: there are {count} snapshots, numbered from 0 to {count - 1}"
        )
    declared = 4 * count * len(patterns) * dn[0].size
    check_memory(
        f"{mask}: {count} snapshots of {len(patterns)} slots, {readable_shape(dn.shape[1:])} pixels,", declared
    )
    return Captures(
        patterns=np.ascontiguousarray(patterns, np.float32),
        sequence=np.tile(np.arange(len(patterns), dtype=np.int64), (count, 1)),
        measurement=np.ascontiguousarray(dn),
        scene=np.broadcast_to(np.float32(np.nan), (count, len(patterns), *dn.shape[1:])),
        aperture=np.ones(count, np.float32),
        exposure=np.ones(count, np.float32),
        kind=("unknown",) * count,
        bit_depth=bit_depth,
        verification=None if verification is None else tuple(int(number) for number in verification),
        name=name,
    )
