"""Paired comparison of two hypotheses by how well they predict the same held-out pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.stats import norm, wilcoxon

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.diagnosis.blind.held_out.prediction import HeldOutErrors, Predictor, textured_window
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import MaskContrast
from sci_lightning.encoder.light_path import LightPath

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


LARGEST_FIELD = 512
"""Side in pixels beyond which only the window of this side with the most texture is judged."""
MASK_HELPS = 0.01
"""p-value below which the mask helps to predict held-out pixels."""
WITHOUT_MASK = LightPath([MaskContrast(leak=1.0)])
"""A camera whose mask is the same everywhere."""
INDIFFERENT = 1e-4
"""Part of the prediction error below which a change of it is a matter of rounding."""


@dataclass(frozen=True)
class PredictionVerdict:
    """What held-out pixels say about the camera that a diagnosis found.

    Attributes:
        gap: the ideal camera against the corrected one.
        by_effect: the corrected camera without one of its effects against the whole one, by effect.
        without_mask: a camera whose mask is the same everywhere against the corrected one. Whatever weakens a wrong
            mask makes held-out pixels more predictable; only what is better than no mask at all speaks for a camera.
        verification: ``gap`` on the snapshots that were set aside; None where there are none.
    """

    gap: PairedComparison
    by_effect: dict[str, PairedComparison]
    without_mask: PairedComparison
    verification: PairedComparison | None = None

    def mask_helps(self) -> bool:
        """Return whether the corrected camera predicts held-out pixels better than one without any mask."""
        return self.without_mask.fall > 0 and self.without_mask.p_value < MASK_HELPS

    def contradicted(self, max_p_value: float = 0.05) -> tuple[str, ...]:
        """Return the effects that change what is predicted and do not make held-out pixels more predictable.

        Effects that a decoder absorbs, such as another order of the patterns, have no vote. Where snapshots that were
        set aside do not confirm the whole camera, all of its effects are contradicted.
        """
        if self.verification is not None and _speaks_against(self.verification, max_p_value):
            return tuple(self.by_effect)
        return tuple(name for name, evidence in self.by_effect.items() if _speaks_against(evidence, max_p_value))


def _speaks_against(evidence: PairedComparison, max_p_value: float) -> bool:
    return abs(evidence.fall) > INDIFFERENT and evidence.p_value > max_p_value


def predictor_of(
    camera: SnapshotCamera, border: Border | None, seed: int, decoder: Decoder | None = None, folds: int = 2
) -> Predictor:
    """Return what predicts held-out pixels of snapshots; of a large field, the window with the most texture."""
    window = textured_window(camera.measurement, LARGEST_FIELD) if max(camera.size) > LARGEST_FIELD else None
    return Predictor(camera.measurement, decoder, folds=folds, seed=seed, border=border, window=window)
