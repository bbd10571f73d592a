"""Paired comparison of two hypotheses by how well they predict the same held-out pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.stats import norm, wilcoxon

from sci_lightning.diagnosis.blind.held_out.prediction import HeldOutErrors

BLOCK = 16
"""Side in pixels of the blocks that count as independent: several times the reach of a reconstruction's errors."""
FEWEST_BLOCKS = 6
"""A snapshot with fewer blocks has no vote of its own, but one together with others as small: with fewer, no p-value
falls below 0.02."""
ASKS_FOR_IT = 0.05
"""p-value of one snapshot below which it asks for the candidate."""


@dataclass(frozen=True)
class PairedComparison:
    """What held-out pixels say about a candidate against a reference.

    Attributes:
        before, after: prediction error of the reference and of the candidate.
        by_capture: pairs of the two for every snapshot.
        p_value: probability of such an advantage of the candidate, or a larger one, where both predict equally well;
            corrected for the number of candidates among which this one was chosen.
        agree: number of snapshots that ask for the candidate by themselves.
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

    def describe(self) -> dict[str, Any]:
        """Return this as a report holds it, as plain data."""
        return {
            "prediction_error": {"before": self.before, "after": self.after},
            "by_capture": [{"before": before, "after": after} for before, after in self.by_capture],
            "p_value": self.p_value,
            "agree": self.agree,
            "snapshots": self.snapshots,
            "blocks": self.blocks,
        }


def compare(
    reference: HeldOutErrors, candidate: HeldOutErrors, candidates: int = 1, block: int = BLOCK
) -> PairedComparison:
    """Compare two hypotheses pixel by pixel, block by block and snapshot by snapshot.

    For every block the logarithm of the ratio of the two mean squared errors is taken. A one-sided signed-rank test of
    Wilcoxon over the blocks of a snapshot gives its p-value; the snapshots are combined by Stouffer's method, with
    equal weights. Blocks rather than pixels are compared because neighbouring errors of a reconstruction are not
    independent.

    Args:
        reference: errors under the simpler hypothesis.
        candidate: errors of the same pixels under the other one.
        candidates: number of hypotheses among which the candidate was chosen by these very pixels; the p-value is
            multiplied by it (Bonferroni). 1 where it was chosen by other snapshots.
        block: side of the blocks in pixels.
    """
    by_snapshot = [_log_ratios(*pair, block) for pair in zip(reference.squared, candidate.squared, strict=True)]
    small = [ratios for ratios in by_snapshot if len(ratios) < FEWEST_BLOCKS]
    votes = [ratios for ratios in by_snapshot if len(ratios) >= FEWEST_BLOCKS]
    alone = [_p_value(ratios) for ratios in votes if np.any(ratios)]
    together = np.concatenate(small) if small else np.zeros(0)
    pooled = [_p_value(together)] if len(together) >= FEWEST_BLOCKS and np.any(together) else []
    scores = [float(norm.isf(min(max(p_value, 1e-300), 1 - 1e-15))) for p_value in (*alone, *pooled)]
    p_value = float(norm.sf(sum(scores) / math.sqrt(len(scores)))) if scores else 1.0
    return PairedComparison(
        before=reference.prediction_error,
        after=candidate.prediction_error,
        by_capture=tuple(zip(reference.by_capture, candidate.by_capture, strict=True)),
        p_value=min(1.0, candidates * p_value),
        agree=sum(p_value < ASKS_FOR_IT for p_value in alone),
        snapshots=len(reference.squared),
        blocks=sum(map(len, by_snapshot)),
    )


def _p_value(ratios: np.ndarray) -> float:
    return float(wilcoxon(ratios, alternative="greater").pvalue)


def _log_ratios(first: torch.Tensor, second: torch.Tensor, block: int) -> np.ndarray:
    """Return the logarithm of ``first`` over ``second``, mean squared errors of every block that has any."""
    sums = []
    for squared in (first, second):
        height, width = squared.shape
        padded = torch.nn.functional.pad(squared.nan_to_num(0).double(), (0, -width % block, 0, -height % block))
        sums.append(padded.unfold(0, block, block).unfold(1, block, block).sum((-2, -1)).flatten())
    counted = (sums[0] > 0) & (sums[1] > 0)
    return np.asarray((sums[0][counted] / sums[1][counted]).log().numpy())
