"""Held-out pixels of snapshots: which they are, how well they are predicted, and by which of two hypotheses better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.stats import norm, wilcoxon
from torch.nn import functional as F

from sci_lightning.errors import BadInput

TILE = 64
"""Side in pixels of the pattern of held-out pixels, which repeats over the field."""
REPULSION_REACH = 0.6
"""Reach of the repulsion between held-out pixels, in units of their mean distance."""
NEIGHBOURS = torch.tensor([[0.5, 1.0, 0.5], [1.0, 0.0, 1.0], [0.5, 1.0, 0.5]])
"""Weights of a pixel's neighbours when it is filled in."""
VOTING_BLOCK_PX = 16
"""Side in pixels of the blocks that count as independent: several times the reach of a reconstruction's errors."""
MIN_VOTING_BLOCKS = 6
"""A snapshot with fewer blocks has no vote of its own, but one together with others as small: with fewer, no p-value
falls below 0.02."""
SUPPORT_P = 0.05
"""p-value of one snapshot below which it supports the candidate."""


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
    repulsion = np.exp(-0.5 * (distance[:, None] ** 2 + distance**2) * share / REPULSION_REACH**2)
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


@dataclass(frozen=True)
class HeldOutErrors:
    """How well a hypothesis predicts held-out pixels.

    Attributes:
        squared: float32 ``(N, H, W)`` squared error of every held-out pixel, in units of full scale; NaN elsewhere.
        variance: ``(N,)`` variance of the recorded values of the held-out pixels.
        origin: (row, column) of the first pixel in the field.
    """

    squared: torch.Tensor
    variance: torch.Tensor
    origin: tuple[int, int] = (0, 0)

    @property
    def by_capture(self) -> tuple[float, ...]:
        """RMS error of every snapshot's held-out pixels, as a part of their standard deviation."""
        mean = self.squared.double().flatten(1).nanmean(1)
        return tuple((mean / self.variance.double()).sqrt().tolist())

    @property
    def prediction_error(self) -> float:
        """Root mean square of :attr:`by_capture`."""
        ratios = torch.tensor(self.by_capture, dtype=torch.float64)
        return float(ratios.square().mean().sqrt())

    def take(self, snapshots: Sequence[int]) -> HeldOutErrors:
        """Return the errors of some of the snapshots, by their numbers."""
        which = torch.tensor(list(snapshots), dtype=torch.long)
        return HeldOutErrors(self.squared[which], self.variance[which], self.origin)


@dataclass(frozen=True)
class PairedComparison:
    """What held-out pixels say about a candidate against a reference.

    Attributes:
        before, after: prediction error of the reference and of the candidate.
        by_capture: pairs of the two for every snapshot.
        p_value: probability of such an advantage of the candidate, or a larger one, where both predict equally well.
        agree: number of snapshots that support the candidate by themselves.
        snapshots: number of snapshots.
        blocks: number of blocks that were compared.
    """

    before: float
    after: float
    by_capture: tuple[tuple[float, float], ...]
    p_value: float
    agree: int
    snapshots: int
    blocks: int

    @property
    def fall(self) -> float:
        """The part of the prediction error that the candidate removes; negative where it adds to it."""
        return 1 - self.after / self.before

    def sides(self) -> dict[str, dict[str, Any]]:
        """Return the prediction errors ``before`` and ``after``, of all snapshots and of every one, as plain data."""
        return {
            when: {"prediction_error": error, "by_capture": [pair[which] for pair in self.by_capture]}
            for which, (when, error) in enumerate((("before", self.before), ("after", self.after)))
        }


def compare_errors(reference: HeldOutErrors, candidate: HeldOutErrors) -> PairedComparison:
    """Compare two hypotheses pixel by pixel, block by block and snapshot by snapshot.

    For every block the logarithm of the ratio of the two mean squared errors is taken. A one-sided signed-rank test of
    Wilcoxon over the blocks of a snapshot gives its p-value; the snapshots are combined by Stouffer's method, with
    equal weights. Blocks rather than pixels are compared because neighbouring errors of a reconstruction are not
    independent.

    Args:
        reference: errors under the simpler hypothesis.
        candidate: errors of the same pixels under the other one.
    """
    by_snapshot = [_log_ratios(*pair) for pair in zip(reference.squared, candidate.squared, strict=True)]
    small = [ratios for ratios in by_snapshot if len(ratios) < MIN_VOTING_BLOCKS]
    votes = [ratios for ratios in by_snapshot if len(ratios) >= MIN_VOTING_BLOCKS]
    alone = [_p_value(ratios) for ratios in votes if np.any(ratios)]
    together = np.concatenate(small) if small else np.zeros(0)
    pooled = [_p_value(together)] if len(together) >= MIN_VOTING_BLOCKS and np.any(together) else []
    scores = [float(norm.isf(min(max(p_value, 1e-300), 1 - 1e-15))) for p_value in (*alone, *pooled)]
    p_value = float(norm.sf(sum(scores) / math.sqrt(len(scores)))) if scores else 1.0
    return PairedComparison(
        before=reference.prediction_error,
        after=candidate.prediction_error,
        by_capture=tuple(zip(reference.by_capture, candidate.by_capture, strict=True)),
        p_value=p_value,
        agree=sum(p_value < SUPPORT_P for p_value in alone),
        snapshots=len(reference.squared),
        blocks=sum(map(len, by_snapshot)),
    )


def _p_value(ratios: np.ndarray) -> float:
    return float(wilcoxon(ratios, alternative="greater").pvalue)


def _log_ratios(first: torch.Tensor, second: torch.Tensor) -> np.ndarray:
    """Return the logarithm of ``first`` over ``second``, mean squared errors of every block that has any."""
    side, sums = VOTING_BLOCK_PX, []
    for squared in (first, second):
        height, width = squared.shape
        padded = F.pad(squared.nan_to_num(0).double(), (0, -width % side, 0, -height % side))
        sums.append(padded.unfold(0, side, side).unfold(1, side, side).sum((-2, -1)).flatten())
    counted = (sums[0] > 0) & (sums[1] > 0)
    return np.asarray((sums[0][counted] / sums[1][counted]).log().numpy())
