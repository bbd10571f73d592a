"""Photographs as luma, for video that is made of them: those that come with scikit-image, or those of a file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput
from sci_lightning.files.npy_file import npz_arrays
from sci_lightning.plain_text import excerpt

TRAINING = (
    "astronaut.png",
    "brick.png",
    "chelsea.png",
    "grass.png",
    "ihc.png",
    "moon.png",
    "motorcycle_left.png",
    "page.png",
    "rocket.jpg",
    "text.png",
)
HELD_OUT = ("camera.png", "coffee.png", "coins.png", "gravel.png")
"""Photographs inside the installed package: nothing is downloaded, and no picture is used for both."""
COLOURED = ("coffee.png", "hubble_deep_field.jpg", "retina.jpg")
"""Photographs in colour that no training uses."""

MOST_BYTES = 256 * 2**20
"""Most bytes of all photographs of a file: as float32 and in three resolutions they take five times as much memory."""
LEAST_SIDE = 64
"""Pixels of a photograph's shorter side."""


@dataclass(frozen=True)
class Photograph:
    """One picture in several resolutions.

    Attributes:
        name: of the file without its ending, or of the array.
        levels: float32 ``(H / 2**k, W / 2**k)`` in [0, 1] for k = 0, 1, 2: each of half the resolution before.
    """

    name: str
    levels: tuple[torch.Tensor, ...]

    def level(self, scale: float) -> tuple[torch.Tensor, float]:
        """Return the level for sampling every ``scale`` pixels of the original, and this step in the level's pixels."""
        k = min(max(round(np.log2(scale)), 0), len(self.levels) - 1)
        return self.levels[k], scale / 2**k


def load_photographs(names: tuple[str, ...], band: int | None = None) -> list[Photograph]:
    """Load photographs by file name, as luma or red (0), green (1) or blue (2) alone.

    Raises:
        BadInput: the installed scikit-image lacks one.
    """
    import skimage
    from PIL import Image

    folder = Path(skimage.__file__).parent / "data"
    photographs = []
    for name in names:
        try:
            with Image.open(folder / name) as image:
                levels = np.array(image.convert("L") if band is None else image.convert("RGB").getchannel(band))
        except OSError as error:
            raise BadInput(f"{folder / name}: missing; reinstall scikit-image, which brings it") from error
        photographs.append(_photograph(Path(name).stem, levels))
    return photographs


def read_photographs(path: str | Path) -> list[Photograph]:
    """Read the photographs of a file: ``.npz`` with two or more uint8 arrays ``(height, width)``.

    Raises:
        BadInput: no such file, one that is damaged, an array of another kind, or more than :data:`MOST_BYTES` of them.
    """
    path = Path(path)
    try:
        arrays = npz_arrays(path)
    except Exception as error:  # a damaged header leads NumPy anywhere
        raise BadInput(f"{path}: not readable as .npz of photographs ({excerpt(error)})") from error
    if len(arrays) < 2 or sum(math.prod(array.shape) for array in arrays.values()) > MOST_BYTES:
        raise BadInput(f"{path}: expected two or more photographs, one an array, of {MOST_BYTES // 2**20} MB at most")
    for name, array in arrays.items():
        if array.dtype != "uint8" or len(array.shape) != 2 or min(array.shape) < LEAST_SIDE:
            raise BadInput(
                f"{path}: '{excerpt(name)}' is {excerpt(array.dtype)} of shape {array.shape}; a photograph is uint8 "
                f"(height, width) of at least {LEAST_SIDE} x {LEAST_SIDE} pixels"
            )
    try:
        return [_photograph(name, array.read()) for name, array in arrays.items()]
    except Exception as error:
        raise BadInput(f"{path}: its photographs cannot be read ({excerpt(error)})") from error


def _photograph(name: str, luma: np.ndarray) -> Photograph:
    finest = torch.from_numpy(luma).float().div_(255)
    return Photograph(name, (finest, *(_shrink(finest, k) for k in (1, 2))))


def _shrink(picture: torch.Tensor, k: int) -> torch.Tensor:
    size = [round(side / 2**k) for side in picture.shape]
    small = F.interpolate(picture[None, None], size, mode="bilinear", antialias=True)
    return small[0, 0].clamp_(0, 1)
