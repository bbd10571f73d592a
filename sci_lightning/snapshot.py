"""A snapshot that a camera took, read from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from sci_lightning.errors import BadInput
from sci_lightning.picture_file import read_pictures

LARGEST_SUM = 100.0
"""A sum of frames that no sensor clipped is at most T times full scale; beyond this a file holds DN."""


def read_snapshot(
    path: str | Path, *, key: str | None = None, full_scale: float | None = None, bit_depth: int = 8
) -> torch.Tensor:
    """Read one or several snapshots.

    Args:
        path: TIFF or PNG (one grey picture, or a TIFF stack), NPY ``(H, W)`` or ``(N, H, W)``, or MAT, in which several
            snapshots are ``(H, W, N)``.
        key: name of the array in a MAT file; None takes ``meas``, else the only array that fits.
        full_scale: the value that is 1.0. None: floating-point files are taken as they are; of integer files it is the
            full scale of ``bit_depth`` if no value exceeds it, else the largest value of the integer type.
        bit_depth: of the sensor that the decoder was trained with.

    Returns:
        measurement float32 ``(N, H, W)``, normalised by full scale.

    Raises:
        BadInput: unreadable file, colour, not finite, a full scale that is not positive or is needed.
    """
    path = Path(path)
    values = read_pictures(path, prefer="meas", key=key)
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
    return measurement
