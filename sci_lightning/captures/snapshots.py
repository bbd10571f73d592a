"""Snapshots of unknown scenes from files: parts of full scale for a decoder, or raw DN with their mask as captures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.light_scale import BIT_DEPTHS, LARGEST_SUM, full_scale_of, raw_dn, step_of
from sci_lightning.captures.mask_fit import mask_of_snapshots
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.packed_file import RawLayout
from sci_lightning.files.picture_file import read_pictures
from sci_lightning.files.stored_array import readable_shape

CONVERTERS = tuple(2**bits - 1 for bits in BIT_DEPTHS)
"""Largest numbers of cameras."""
DIM_CAMERA = 0.2
"""Mean of whole numbers, over the largest of their bit depth, below which they may be a sum of frames of 8 bits."""
DIM_LEVEL = 0.25
"""An integer file whose largest value is below this part of full scale may hold numbers of fewer bits."""
DARK_LEVEL = 0.01
"""A snapshot whose mean is below this part of full scale is almost dark."""
MOST_SATURATED = 0.1
"""Part of the pixels that may be saturated without a word."""


@dataclass(frozen=True)
class Snapshot:
    """The content of a file of snapshots.

    Attributes:
        name: of the file, for messages.
        measurement: float32 ``(N, H, W)``, normalised by full scale.
        full_scale: the number in the file that corresponds to 1.0.
        integer: whether the file holds whole numbers.
        chosen: why this full scale was chosen; empty where it was given.
    """

    name: str
    measurement: torch.Tensor
    full_scale: float
    integer: bool
    chosen: str = ""

    def as_sum(self, brightest: float) -> Snapshot:
        """Return the snapshot read as a sum of frames of 8 bits, as software writes it, where that is likelier.

        That is so for whole numbers that are dim for a camera with so many bits, and that such a sum can reach. An
        underexposed camera is taken for one as well, which makes its frames brighter.

        Args:
            brightest: largest sum over time of the mask.
        """
        largest = round(float(self.measurement.max()) * self.full_scale)
        dim = float(self.measurement.mean()) < DIM_CAMERA and self.full_scale in CONVERTERS
        if not (self.chosen and self.integer and dim and 255 < largest <= 255 * brightest):
            return self
        chosen = (
            f"taken for a sum of 8-bit frames made by software, since values end at {largest:g}, low for a camera; "
            f"if a camera recorded it, give full_scale={self.full_scale:g}"
        )
        return replace(self, measurement=self.measurement * (self.full_scale / 255), full_scale=255.0, chosen=chosen)

    def doubt(self, brightest: float) -> str:
        """Return one line on why the full scale seems to be wrong and which may be right; empty if it seems right.

        Args:
            brightest: the largest possible measurement in units of full scale: 1 behind a sensor, the mask's sum over
                time without one.
        """
        top, mean = float(self.measurement.max()), float(self.measurement.mean())
        largest = top * self.full_scale
        level = f"the largest value is {largest:g}, the mean level {mean:.3g} of full_scale={self.full_scale:g}"
        if top == 0 and mean == 0:
            return "the snapshot is black: every value is 0; is the array the right one, the lens open?"
        fitting = [end for end in CONVERTERS if end + 1 > largest]
        if top > 1.05 * brightest:
            fits = next((end for end in CONVERTERS if largest <= 1.05 * brightest * end), None)
            likely = f"full_scale={fits}" if fits else "another full_scale="
            return (
                f"{level}; with this mask no more than {brightest:.3g} can be reached: check the units, give {likely}?"
            )
        saturated = self._saturated(brightest)
        if saturated > MOST_SATURATED:
            return (
                f"{100 * saturated:.3g} % of the pixels are saturated (full_scale={self.full_scale:g}): "
                "what they show cannot be recovered; expose for a shorter time"
            )
        if self.integer and top <= DIM_LEVEL and self.full_scale in CONVERTERS and fitting[0] < self.full_scale:
            bits = fitting[0].bit_length()
            return (
                f"{level}; numbers of {bits} bits in a file made for more? Then give full_scale={fitting[0]} (of a sum "
                "of frames made by software: that of one frame, as 255); else the exposure was short"
            )
        if mean < 0:
            return f"{level}; values below 0: was a dark frame subtracted twice? Give the raw snapshot"
        if mean < DARK_LEVEL:
            return f"{level}; that is nearly dark: check full_scale= and the exposure"
        return ""

    def _saturated(self, brightest: float) -> float:
        """Return the part of the pixels at the converter's end: full scale, or the largest number of a bit depth.

        With a full scale below the converter's end, as for a light scale of its own, values beyond it are no sign.
        """
        top = float(self.measurement.max())
        ends = [2**bits - 1 << shift for bits in BIT_DEPTHS for shift in {0, 16 - bits}]
        if brightest <= 1:
            return float((self.measurement >= 1).float().mean())
        if self.integer and round(top * self.full_scale) in ends:
            return float((self.measurement >= top).float().mean())
        return 0.0


def read_snapshot(
    source: str | Path | np.ndarray | torch.Tensor,
    *,
    key: str | None = None,
    full_scale: float | None = None,
    bit_depth: int | None = None,
    raw: RawLayout | None = None,
) -> Snapshot:
    """Read one or more snapshots.

    Args:
        source: the numbers themselves, ``(H, W)`` or ``(N, H, W)``, or a file of them: a grey picture, a TIFF stack,
            NPY, NPZ, HDF5, or MAT, in which several snapshots are ``(H, W, N)``; see
            :func:`~sci_lightning.files.picture_file.read_pictures`.
        key: name of the array in a MAT, NPZ or HDF5 file; None takes ``meas``, else the only array that fits.
        full_scale: the value that is 1.0. None: chosen, see :func:`~sci_lightning.captures.light_scale.full_scale_of`.
        bit_depth: bits of the sensor that the decoder was trained with, if it has one.
        raw: what a file of raw numbers does not say of itself; its bits then count as those of the sensor.

    Raises:
        BadInput: unreadable file, colour, not finite, a full scale that is not positive or is needed.
    """
    if isinstance(source, (str, Path)):
        path, values = str(source), read_pictures(source, prefer="meas", key=key, setting="key", raw=raw)
    else:
        path, values = "measurement", torch.as_tensor(source).detach().cpu().numpy()
    bit_depth = bit_depth if raw is None else raw.bits
    if values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or values.dtype.kind not in "uif" or not values.size:
        raise BadInput(f"{path}: {values.dtype} {values.shape}, expected numbers (H, W) or (N, H, W)")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise BadInput(f"{path}: the snapshot holds NaN or infinite values; every pixel must be a finite number")
    whole, chosen = values.dtype.kind in "ui", ""
    if full_scale is None:
        full_scale, chosen = full_scale_of(values, bit_depth)
        whole = whole or full_scale > 1
        if full_scale == 1 and values.max() > LARGEST_SUM:
            raise BadInput(
                f"{path}: values up to {values.max():g} are no fraction of full scale; give full_scale=255, .."
            )
    if not full_scale > 0:
        raise BadInput(f"full_scale must be positive, got {full_scale!r}")
    measurement = torch.from_numpy(values.astype(np.float32)) / full_scale
    return Snapshot(path, measurement, float(full_scale), whole, chosen)


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
