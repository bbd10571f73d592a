"""Held-out pixels: which pixels of a snapshot a reconstruction must not see, so that they can judge it."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput

TILE = 64
"""Side in pixels of the pattern of held-out pixels, which repeats over the field."""
SPREAD = 0.6
"""Reach of the repulsion between held-out pixels, in units of their mean distance."""
NEIGHBOURS = torch.tensor([[0.5, 1.0, 0.5], [1.0, 0.0, 1.0], [0.5, 1.0, 0.5]])
"""Weights of a pixel's neighbours when it is filled in."""


def blue_noise_folds(size: tuple[int, int], share: float = 0.05, folds: int = 4, seed: int = 0) -> torch.Tensor:
    """Return disjoint sets of pixels that are evenly spread but follow no lattice (blue noise).

    Every set is grown by placing the next pixel into the largest void among those placed before (void-and-cluster),
    on a tile that continues at its opposite sides.

    Args:
        size: (H, W) of the field in pixels.
        share: part of the pixels in one set.
        folds: number of sets, K.
        seed: of the first pixels and of ties.

    Returns:
        bool ``(K, H, W)``; no pixel is in two sets.

    Raises:
        BadInput: the sets need more pixels than there are.

    Source: Ulichney, "The void-and-cluster method for dither array generation", SPIE 1913, 1993.
    """
    if not 0 < share * folds <= 1 or folds < 1:
        raise BadInput(f"{folds} folds of {share:g} of the pixels: together at most all pixels can be held out")
    tile = _tile(share, folds, seed)
    repeats = tuple(-(-length // TILE) for length in size)
    labels = np.tile(tile, repeats)[: size[0], : size[1]]
    return torch.from_numpy(labels[None] == np.arange(folds)[:, None, None])


def _tile(share: float, folds: int, seed: int) -> np.ndarray:
    """Return ``(TILE, TILE)``: the number of the set that a pixel belongs to, -1 for none."""
    random = np.random.default_rng(seed)
    distance = np.minimum(np.arange(TILE), TILE - np.arange(TILE))
    repulsion = np.exp(-0.5 * (distance[:, None] ** 2 + distance**2) * share / SPREAD**2)
    labels = np.full((TILE, TILE), -1)
    for fold in range(folds):
        energy = 1e-3 * random.random((TILE, TILE))
        energy[labels >= 0] = np.inf
        for _ in range(max(1, round(share * TILE**2))):
            place = np.unravel_index(energy.argmin(), energy.shape)
            labels[place] = fold
            energy += np.roll(repulsion, place, (0, 1))
            energy[place] = np.inf
    return labels


def fill_in(images: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Replace unknown pixels by the weighted mean of their known neighbours, from the rim of every hole inwards.

    Args:
        images: ``(N, H, W)``.
        known: bool, broadcasts to ``(N, H, W)``.

    Returns:
        ``(N, H, W)``; known pixels are unchanged, an image without any known pixel is 0.
    """
    known = known.expand_as(images)
    filled = torch.where(known, images, torch.zeros_like(images))
    kernel = NEIGHBOURS.to(images)[None, None]
    while not known.all():
        weight = F.conv2d(known.to(images)[:, None], kernel, padding=1)[:, 0]
        rim = ~known & (weight > 0)
        if not rim.any():
            break
        mean = F.conv2d(filled[:, None], kernel, padding=1)[:, 0] / weight.clamp(min=1e-12)
        filled = torch.where(rim, mean, filled)
        known = known | rim
    return filled
