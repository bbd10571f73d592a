"""Snapshots that a camera recorded, read from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from sci_lightning.errors import BadInput
from sci_lightning.files.packed_file import RawLayout
from sci_lightning.files.picture_file import read_pictures

BIT_DEPTHS = (8, 10, 12, 14, 16)
"""Usual bit depths of cameras."""
DIM_LEVEL = 0.25
"""An integer file whose largest value is below this part of full scale may hold numbers of fewer bits."""
DARK_LEVEL = 0.01
"""A snapshot whose mean is below this part of full scale is almost dark."""
MOST_SATURATED = 0.1
"""Part of the pixels that may be saturated without a word."""
LARGEST_SUM = 100.0
"""A sum of frames that no sensor clipped is at most T times full scale; larger values are taken for DN."""


@dataclass(frozen=True)
class Snapshot:
    """The content of a file of snapshots.

    Attributes:
        path: the file.
        measurement: float32 ``(N, H, W)``, normalised by full scale.
        full_scale: the number in the file that corresponds to 1.0.
        integer: whether the file holds integers.
    """

    path: Path
    measurement: torch.Tensor
    full_scale: float
    integer: bool

    def doubt(self, brightest: float) -> str:
        """Return one line on why the full scale seems to be wrong and which may be right; empty if it seems right.

        Args:
            brightest: the largest possible measurement in units of full scale: 1 behind a sensor, the mask's sum over
                time without one.
        """
        top, mean = float(self.measurement.max()), float(self.measurement.mean())
        largest = top * self.full_scale
        level = f"the largest value is {largest:g}, the mean level {mean:.3g} of full_scale={self.full_scale:g}"
        about = f"{self.path}: {level}"
        if top == 0 and mean == 0:
            return f"{self.path}: the snapshot is black: every value is 0; is the array the right one, the lens open?"
        fitting = [2**bits - 1 for bits in BIT_DEPTHS if 2**bits > largest]
        if top > 1.05 * brightest:
            fits = next((2**bits - 1 for bits in BIT_DEPTHS if largest <= 1.05 * brightest * (2**bits - 1)), None)
            likely = f"full_scale={fits}" if fits else "another full_scale="
            return (
                f"{about}; with this mask no more than {brightest:.3g} can be reached: check the units, give {likely}?"
            )
        saturated = float((self.measurement >= 1).float().mean()) if self.integer or brightest <= 1 else 0.0
        if saturated > MOST_SATURATED:
            return (
                f"{self.path}: {100 * saturated:.3g} % of the pixels are saturated (full_scale={self.full_scale:g}): "
                "what they show cannot be recovered; expose for a shorter time"
            )
        if self.integer and top <= DIM_LEVEL and fitting and fitting[0] < self.full_scale:
            bits = fitting[0].bit_length()
            return (
                f"{about}; numbers of {bits} bits in a file made for more? Then give full_scale={fitting[0]} (of a sum "
                "of frames made by software: that of one frame, as 255); else the exposure was short"
            )
        if mean < 0:
            return f"{about}; values below 0: was a dark frame subtracted twice? Give the raw snapshot"
        if mean < DARK_LEVEL:
            return f"{about}; that is nearly dark: check full_scale= and the exposure"
        return ""


def read_snapshot(
    path: str | Path,
    *,
    key: str | None = None,
    full_scale: float | None = None,
    bit_depth: int = 8,
    raw: RawLayout | None = None,
) -> Snapshot:
    """Read one or more snapshots.

    Args:
        path: a grey picture, a TIFF stack, NPY, NPZ or HDF5 ``(H, W)`` or ``(N, H, W)``, or MAT, in which several
            snapshots are ``(H, W, N)``; see :func:`~sci_lightning.files.picture_file.read_pictures`.
        key: name of the array in a MAT, NPZ or HDF5 file; None takes ``meas``, else the only array that fits.
        full_scale: the value that is 1.0. None: floating-point files are taken as they are; of integer files it is the
            full scale of ``bit_depth`` if no value exceeds it, else the largest value of the integer type.
        bit_depth: bits of the sensor that the decoder was trained with.
        raw: what a file of raw numbers does not say of itself; its bits then count as those of the sensor.

    Raises:
        BadInput: unreadable file, colour, not finite, a full scale that is not positive or is needed.
    """
    path = Path(path)
    values = read_pictures(path, prefer="meas", key=key, setting="key", raw=raw)
    bit_depth = bit_depth if raw is None else raw.bits
    if values.ndim == 2:
        values = values[None]
    if full_scale is None:
        full_scale = 1.0
        if values.dtype.kind == "f" and values.max() > LARGEST_SUM:
            raise BadInput(
                f"{path}: values up to {values.max():g} are no fraction of full scale; give full_scale=255, .."
            )
        if values.dtype.kind in "ui":
            sensor = 2**bit_depth - 1
            full_scale = sensor if values.max() <= sensor else np.iinfo(values.dtype).max
    if not full_scale > 0:
        raise BadInput(f"full_scale must be positive, got {full_scale!r}")
    measurement = torch.from_numpy(values.astype(np.float32)) / full_scale
    if not torch.isfinite(measurement).all():
        raise BadInput(f"{path}: the snapshot holds NaN or infinite values; every pixel must be a finite number")
    return Snapshot(path, measurement, float(full_scale), values.dtype.kind in "ui")
