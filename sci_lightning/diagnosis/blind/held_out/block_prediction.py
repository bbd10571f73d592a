"""Prediction of held-out pixels by the prior itself: what the other pixels of a block say about them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from sci_lightning.diagnosis.blind.held_out.held_out_pixels import blue_noise_folds
from sci_lightning.diagnosis.blind.held_out.paired_comparison import PredictionVerdict, compare
from sci_lightning.diagnosis.blind.held_out.prediction import HeldOutErrors
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood, SeenBlocks
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.model.camera_model import Hypothesis

UNSEEN = 1e6
"""Variance of a pixel that is held out, as if noise had drowned it; relative light is about 1."""


class BlockPredictor:
    r"""Predicts held-out pixels of snapshots by their conditional mean, given the other pixels of their block.

    With the covariance S of a block's light and the noise N, which is endless where a pixel is held out, the light of
    a block is expected to be :math:`A 1 + S (S + N)^{-1} (y - A 1)`. Components of the prior count by how likely the
    seen pixels of a block are by them. No reconstruction is needed, and a mask without contrast is as good a
    hypothesis as any other one.

    Args:
        likelihood: knows the snapshots and the prior.
        blocks: ``(blocks,)`` bool, blocks that judge by every hypothesis.
        share: part of the pixels that one fold holds out.
        folds: number of folds.
        seed: of the choice of pixels.

    Source: Rasmussen and Williams, "Gaussian processes for machine learning", MIT Press 2006, Eq. 2.23.
    """

    def __init__(
        self, likelihood: BlindLikelihood, blocks: torch.Tensor, share: float = 0.05, folds: int = 4, seed: int = 0
    ) -> None:
        self.likelihood = likelihood
        self.numbers = blocks.nonzero()[:, 0]
        size = likelihood.model.observation.size
        held_out = blue_noise_folds(size, share, folds, seed).float()
        self._folds = likelihood.cut(held_out, 0)[:, self.numbers].bool()  # (folds, b, n)

    @torch.no_grad()
    def errors(self, hypothesis: Hypothesis) -> HeldOutErrors:
        """Return the errors of a hypothesis about the camera, in units of full scale."""
        likelihood, numbers = self.likelihood, self.numbers
        observation = likelihood.model.observation
        weights = likelihood.evaluate(hypothesis, _chosen(numbers, len(likelihood.usable))).weights
        squared = torch.full((len(numbers), len(observation), BLOCK**2), torch.nan, dtype=torch.float64)

        def predict(seen: SeenBlocks) -> None:
            """Write the squared errors of the held-out pixels of some blocks."""
            every = torch.ones(len(weights), len(seen.places), dtype=torch.bool)
            parts = [part for *_, part in likelihood.prior.covariances(seen.mask, seen.operator, every)]
            covariance = torch.cat(parts).unflatten(0, every.shape)
            covariance = seen.with_brightness(covariance, torch.arange(len(seen.places)))
            deviation = seen.deviation
            for fold in self._folds:
                hidden = fold[seen.places]
                noise = torch.where(hidden, UNSEEN, seen.noise)
                factor = torch.linalg.cholesky(covariance + torch.diag_embed(noise))
                weighted = torch.cholesky_solve(deviation.expand(len(weights), *deviation.shape), factor)
                distance = (deviation * weighted * ~hidden[..., None]).sum(-2)
                determinant = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
                shares = (weights.log()[:, None, None] - 0.5 * (distance + determinant[..., None])).softmax(0)
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


def snapshots_that_judge(likelihood: BlindLikelihood, ideal: Hypothesis, corrected: Hypothesis) -> torch.Tensor:
    """Return which snapshots, (N,) bool, have a block without a saturated pixel where both hypotheses predict."""
    model = likelihood.model
    return likelihood.usable[likelihood.inside(model.border(ideal) | model.border(corrected))].any(0)


def judge_by_blocks(
    likelihood: BlindLikelihood,
    ideal: Hypothesis,
    corrected: Hypothesis,
    names: Sequence[str],
    aside: Sequence[int],
    seed: int = 0,
    on_progress: Callable[[str], None] = lambda message: None,
) -> PredictionVerdict:
    """Predict held-out pixels by the ideal camera, the corrected one, that without one effect, and one without a mask.

    Args:
        likelihood: of the snapshots that judge.
        ideal, corrected: the two hypotheses.
        names: effects that were named.
        aside: places of the snapshots that the search has not seen.
        seed: of the choice of pixels.
        on_progress: called with a one-line message at the end.
    """
    model = likelihood.model
    judging = likelihood.inside(model.border(ideal) | model.border(corrected)) & likelihood.usable.any(1)
    predictor = BlockPredictor(likelihood, judging, seed=seed)
    after = predictor.errors(corrected)
    before = predictor.errors(ideal) if names else after
    gap = compare(before, after)
    alone = len(names) == 1
    by_effect = {name: gap if alone else compare(predictor.errors(corrected.without(name)), after) for name in names}
    without_mask = compare(predictor.errors(ideal.with_effect("mask_contrast", {"leak": 1.0})), after)
    on_progress(f"held-out pixels: prediction error {gap.before:.4f} to {gap.after:.4f}")
    verification = compare(before.take(aside), after.take(aside)) if aside else None
    return PredictionVerdict(gap, by_effect, without_mask, verification)


def _chosen(numbers: torch.Tensor, count: int) -> torch.Tensor:
    chosen = torch.zeros(count, dtype=torch.bool)
    chosen[numbers] = True
    return chosen
