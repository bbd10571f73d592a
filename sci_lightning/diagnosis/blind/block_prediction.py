"""Prediction of held-out pixels by the prior itself: what the other pixels of a block say about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.blind.held_out_pixels import (
    HeldOutErrors,
    PairedComparison,
    compare_errors,
    held_out_pixels,
)
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood, SeenBlocks
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.blind.prior import BLOCK, LEAST_SHARE
from sci_lightning.diagnosis.model.hypothesis import Hypothesis

HIDDEN_VARIANCE = 1e6
"""Variance of a pixel that is held out, as if noise had drowned it; relative light is about 1."""
MASK_HELPS_P = 0.01
"""p-value below which the mask helps to predict held-out pixels."""
INDIFFERENT = 1e-4
"""Part of the prediction error below which a change of it is a matter of rounding."""
UNCONFIRMED_P = 0.05
"""p-value above which held-out pixels do not confirm what changes their prediction."""


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
        return self.without_mask.fall > 0 and self.without_mask.p_value < MASK_HELPS_P

    def contradicted(self) -> tuple[str, ...]:
        """Return the effects that change what is predicted and do not make held-out pixels more predictable.

        Effects that a decoder absorbs, such as another order of the patterns, have no vote. Where snapshots that were
        set aside do not confirm the whole camera, all of its effects are contradicted.
        """
        if self.verification is not None and _speaks_against(self.verification):
            return tuple(self.by_effect)
        return tuple(name for name, evidence in self.by_effect.items() if _speaks_against(evidence))


def _speaks_against(evidence: PairedComparison) -> bool:
    return abs(evidence.fall) > INDIFFERENT and evidence.p_value > UNCONFIRMED_P


class BlockPredictor:
    r"""Predicts held-out pixels of snapshots by their conditional mean, given the other pixels of their block.

    With the covariance S of a block's light and the noise N, which is endless where a pixel is held out, the light of
    a block is expected to be :math:`A 1 + S (S + N)^{-1} (y - A 1)`. Components of the prior count by how likely the
    seen pixels of a block are by them. No reconstruction is needed, and a mask without contrast is as good a
    hypothesis as any other one.

    Args:
        likelihood: knows the snapshots and the prior.
        blocks: ``(blocks,)`` bool, blocks that every hypothesis predicts.
        share: part of the pixels that one fold holds out.
        folds: number of folds.
        seed: of the choice of pixels.

    Source: Rasmussen and Williams, "Gaussian processes for machine learning", MIT Press 2006, Eq. 2.23.
    """

    def __init__(
        self, likelihood: BlindLikelihood, blocks: torch.Tensor, share: float = 0.05, folds: int = 4, seed: int = 0
    ) -> None:
        self.likelihood = likelihood
        self.blocks, self.numbers = blocks, blocks.nonzero()[:, 0]
        self._folds = held_out_pixels(len(self.numbers), BLOCK**2, share, folds, seed)

    @torch.no_grad()
    def errors(self, hypothesis: Hypothesis) -> HeldOutErrors:
        """Return the errors of a hypothesis about the camera, in units of full scale."""
        likelihood, numbers = self.likelihood, self.numbers
        observation = likelihood.model.observation
        weights = likelihood.evaluate(hypothesis, self.blocks).weights
        matters = weights > min(LEAST_SHARE, float(weights.max()))
        squared = torch.full((len(numbers), len(observation), BLOCK**2), torch.nan, dtype=torch.float64)

        def predict(seen: SeenBlocks) -> None:
            """Write the squared errors of the held-out pixels of some blocks."""
            every = matters[:, None].expand(-1, len(seen.places))
            parts = [part for *_, part in likelihood.prior.covariances(seen.mask, seen.operator, every)]
            covariance = torch.cat(parts).unflatten(0, (-1, len(seen.places)))
            covariance = seen.with_brightness(covariance, torch.arange(len(seen.places)))
            deviation = seen.deviation
            for fold in self._folds:
                hidden = fold[seen.places]
                noise = torch.where(hidden, HIDDEN_VARIANCE, seen.noise)
                factor = torch.linalg.cholesky(covariance + torch.diag_embed(noise))
                weighted = torch.cholesky_solve(deviation.expand(len(covariance), *deviation.shape), factor)
                distance = (deviation * weighted * ~hidden[..., None]).sum(-2)
                determinant = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
                shares = (weights[matters].log()[:, None, None] - 0.5 * (distance + determinant[..., None])).softmax(0)
                expected = ((covariance @ weighted) * shares[..., None, :]).sum(0)
                error = ((expected - deviation).mT * seen.per_light).square()
                rows, snapshots = seen.places[:, None], seen.members
                squared[rows, snapshots] = torch.where(hidden[:, None], error, squared[rows, snapshots])

        on_every_core(predict, likelihood.moments(hypothesis, numbers))
        squared = torch.where(likelihood.usable[numbers][..., None], squared, torch.nan)
        return self._in_the_field(squared)

    def _in_the_field(self, squared: torch.Tensor) -> HeldOutErrors:
        """Return errors ``(b, N, n)`` of blocks as those of the field, whose recorded values tell the spread."""
        likelihood = self.likelihood
        observation = likelihood.model.observation
        (height, width), (top, left) = observation.size, likelihood.origin
        rows, columns = likelihood.rows, likelihood.columns
        whole = torch.full((len(observation), rows * columns, BLOCK, BLOCK), torch.nan)
        whole[:, self.numbers] = squared.transpose(0, 1).unflatten(2, (BLOCK, BLOCK)).float()
        field = torch.full((len(observation), height, width), torch.nan)
        tiled = whole.unflatten(1, (rows, columns)).transpose(2, 3).reshape(len(observation), rows * BLOCK, -1)
        field[:, top : top + rows * BLOCK, left : left + columns * BLOCK] = tiled
        recorded = torch.where(field.isfinite(), observation.dn / observation.full_scale, torch.nan).flatten(1)
        variance = (recorded - recorded.nanmean(1, keepdim=True)).square().nanmean(1)
        return HeldOutErrors(field, variance)


def predicted_blocks(likelihood: BlindLikelihood, ideal: Hypothesis, corrected: Hypothesis) -> torch.Tensor:
    """Return the blocks, (blocks,) bool, that both hypotheses predict and that are not saturated in every snapshot."""
    border = likelihood.model.border(ideal) | likelihood.model.border(corrected)
    return likelihood.inside(border) & likelihood.usable.any(1)


def of_predictable_snapshots(
    likelihood: BlindLikelihood, ideal: Hypothesis, corrected: Hypothesis
) -> BlindLikelihood | None:
    """Return the likelihood of the snapshots that have a block without a saturated pixel where both predict."""
    predictable = likelihood.usable[predicted_blocks(likelihood, ideal, corrected)].any(0)
    if predictable.all() or not predictable.any():
        return likelihood if predictable.any() else None
    model = likelihood.model
    return BlindLikelihood(model.of_captures(model.observation.take(predictable)), likelihood.prior)


def predict_by_blocks(
    likelihood: BlindLikelihood,
    ideal: Hypothesis,
    corrected: Hypothesis,
    names: Sequence[str],
    verification: Sequence[int],
    seed: int = 0,
) -> PredictionVerdict:
    """Predict held-out pixels by the ideal camera, the corrected one, that without one effect, and one without a mask.

    Args:
        likelihood: of the snapshots.
        ideal, corrected: the two hypotheses.
        names: effects that were named.
        verification: places of the snapshots that the search has not seen.
        seed: of the choice of pixels.
    """
    predictor = BlockPredictor(likelihood, predicted_blocks(likelihood, ideal, corrected), seed=seed)
    after = predictor.errors(corrected)
    before = predictor.errors(ideal) if names else after
    gap = compare_errors(before, after)
    by_effect = {}
    for name in names:  # without the only effect, the corrected camera is the ideal one
        others = before if len(names) == 1 else predictor.errors(corrected.without(name))
        by_effect[name] = compare_errors(others, after)
    without_mask = compare_errors(predictor.errors(ideal.with_effect("mask_contrast", {"leak": 1.0})), after)
    verified = compare_errors(before.take(verification), after.take(verification)) if verification else None
    return PredictionVerdict(gap, by_effect, without_mask, verified)
