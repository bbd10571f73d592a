"""A snapshot that a camera took, read from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from sci_lightning.array_file import ENDINGS, read_array
from sci_lightning.errors import BadInput

PICTURES = (".tif", ".tiff", ".png")
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
    values = _read(path, key)
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


def _read(path: Path, key: str | None) -> np.ndarray:
    if path.suffix.lower() in ENDINGS:
        try:
            return read_array(path, key=key, prefer="meas", dimensions=3)
        except BadInput as three:
            try:
                return read_array(path, key=key, prefer="meas", dimensions=2)
            except BadInput:
                raise three from None
    if path.suffix.lower() not in PICTURES:
        raise BadInput(
            f"{path}: cannot read a snapshot from '{path.suffix}'; use one of {', '.join(PICTURES + ENDINGS)}"
        )
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    from skimage.io import imread

    try:
        picture = np.asarray(imread(path))
    except Exception as error:  # every format has errors of its own
        raise BadInput(f"{path}: not a readable picture, damaged or truncated ({type(error).__name__})") from error
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[-1] in (3, 4)):
        raise BadInput(f"{path}: a snapshot is one grey channel, this picture is {picture.shape}")
    return picture
