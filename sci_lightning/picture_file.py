"""One grey picture, or several, out of a TIFF, PNG, NPY, MAT or HDF5 file, with the numbers as they are stored."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sci_lightning.array_file import ENDINGS, read_array
from sci_lightning.errors import BadInput

PICTURES = (".tif", ".tiff", ".png")


def read_pictures(path: str | Path, *, prefer: str, key: str | None = None) -> np.ndarray:
    """Read ``(H, W)``, or ``(N, H, W)`` of a TIFF stack or a file of arrays (``(H, W, N)`` in a MAT file).

    Args:
        path: .tif, .tiff, .png or one of :data:`~sci_lightning.array_file.ENDINGS`.
        prefer, key: name of the array, see :func:`~sci_lightning.array_file.read_array`.

    Returns:
        Numbers of the type that the file has.

    Raises:
        BadInput: missing or unreadable file, unknown ending, colour, no such array.
    """
    path = Path(path)
    if path.suffix.lower() in ENDINGS:
        try:
            return read_array(path, key=key, prefer=prefer, dimensions=3)
        except BadInput as three:
            try:
                return read_array(path, key=key, prefer=prefer, dimensions=2)
            except BadInput:
                raise three from None
    if path.suffix.lower() not in PICTURES:
        raise BadInput(
            f"{path}: cannot read a picture from '{path.suffix}'; use one of {', '.join(PICTURES + ENDINGS)}"
        )
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    try:
        picture, colour = (_tiff if path.suffix.lower() != ".png" else _png)(path)
    except Exception as error:  # every format has errors of its own
        raise BadInput(f"{path}: not a readable picture, damaged or truncated ({type(error).__name__})") from error
    if colour or picture.ndim not in (2, 3) or picture.size == 0:
        raise BadInput(f"{path}: one grey channel is expected, this picture is {picture.shape}")
    return picture


def _tiff(path: Path) -> tuple[np.ndarray, bool]:
    """Not with scikit-image, which takes a stack of three or four pages for one picture in colour."""
    from tifffile import TiffFile

    with TiffFile(path) as file:
        # several series: pages that were appended one by one
        values = file.asarray() if len(file.series) == 1 else file.asarray(key=slice(None))
        return np.asarray(values), file.pages.first.samplesperpixel > 1


def _png(path: Path) -> tuple[np.ndarray, bool]:
    from skimage.io import imread

    picture = np.asarray(imread(path))
    return picture, picture.ndim > 2
