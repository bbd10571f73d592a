"""The photographs that come with scikit-image, as luma."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput

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


@dataclass(frozen=True)
class Photograph:
    """One picture in several resolutions.

    Attributes:
        name: the file name without its ending.
        levels: float32 ``(H / 2**k, W / 2**k)`` in [0, 1] for k = 0, 1, 2: each of half the resolution before.
    """

    name: str
    levels: tuple[torch.Tensor, ...]

    def level(self, scale: float) -> tuple[torch.Tensor, float]:
        """Return the level for sampling every ``scale`` pixels of the original, and this step in the level's pixels."""
        k = min(max(round(np.log2(scale)), 0), len(self.levels) - 1)
        return self.levels[k], scale / 2**k


def load_photographs(names: tuple[str, ...]) -> list[Photograph]:
    """Load photographs by file name; raise BadInput if the installed scikit-image lacks one."""
    import skimage
    from PIL import Image

    folder = Path(skimage.__file__).parent / "data"
    photographs = []
    for name in names:
        try:
            with Image.open(folder / name) as image:
                luma = np.array(image.convert("L"))
        except OSError as error:
            raise BadInput(f"{folder / name}: missing; reinstall scikit-image, which brings it") from error
        finest = torch.from_numpy(luma).float().div_(255)
        levels = (finest, *(_shrink(finest, k) for k in (1, 2)))
        photographs.append(Photograph(Path(name).stem, levels))
    return photographs


def _shrink(picture: torch.Tensor, k: int) -> torch.Tensor:
    size = [round(side / 2**k) for side in picture.shape]
    small = F.interpolate(picture[None, None], size, mode="bilinear", antialias=True)
    return small[0, 0].clamp_(0, 1)
