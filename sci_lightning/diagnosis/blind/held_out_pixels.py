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

VOTING_BLOCK_PX = 16
"""Side in pixels of the blocks that count as independent: several times the reach of a reconstruction's errors."""
MIN_VOTING_BLOCKS = 6
"""A snapshot with fewer blocks has no vote of its own, but one together with others as small: with fewer, no p-value
falls below 0.02."""
SUPPORT_P = 0.05
"""p-value of one snapshot below which it supports the candidate."""


def held_out_pixels(blocks: int, pixels: int, share: float = 0.05, folds: int = 4, seed: int = 0) -> torch.Tensor:
    """Return disjoint sets of pixels, as many of every block, that follow no pattern.

    Args:
        blocks: their number.
        pixels: of a block.
        share: part of the pixels in one set, rounded to whole pixels of a block; at least one.
        folds: number of sets, K.
        seed: of the choice.

    Returns:
        bool ``(K, blocks, pixels)``; no pixel is in two sets.

    Raises:
        BadInput: the sets need more pixels than there are.
    """
    count = max(1, round(share * pixels))
    if folds < 1 or count * folds > pixels:
        raise BadInput(f"{folds} folds of {share:g} of the pixels: together at most all pixels can be held out")
    order = torch.rand(blocks, pixels, generator=torch.Generator().manual_seed(seed)).argsort(1)
    return order // count == torch.arange(folds)[:, None, None]


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
