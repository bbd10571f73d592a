"""Which of two hypotheses snapshots prefer, in nats calibrated by how much they agree; what may be named, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from scipy.stats import norm, wilcoxon

from sci_lightning.diagnosis.blind.blind_fit import MIN_SNAPSHOTS, BlindFit, BlindFitter, price, tiles
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.undetermined import SHOWN_IF_STRONG, slower_scenes
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.recent import Recent
from sci_lightning.encoder.effects.stage import ModulatorEffect, RelayEffect

MAX_P_SNAPSHOTS = 0.05
"""Probability of the snapshots' signed ranks by chance below which the snapshots themselves prefer a hypothesis."""
MIN_Z = 3.0
"""Standard deviations by which an effect must make the snapshots likelier."""
KEPT_MIN_Z = 2.0
"""The same of an effect that was named; lower, so that none is named and dropped by turns."""
AMPLE_NATS = 100.0
"""Nats from which an effect of the mask's image needs :data:`KEPT_MIN_Z` standard deviations only: a wide
blur leaves few blocks. On validation clips no such effect that was not there has gained a third of it."""
MIN_SUPPORT = 0.75
"""Part of the snapshots that must support an effect."""
DARKEST_SIGMA = 4.0
"""Standard deviations of the noise by which the darkest pixels of a snapshot may lie below no light."""
WEAKENED_BY_SIGMA = 2.0
"""Standard deviations of its own error by which an effect is weakened before it is called impossible."""
SLOWER_ITERATIONS = 4
"""Iterations of the fit of scenes that move less, which starts where a mixture of slots was fitted."""
HYPOTHESES_CACHED = 16
"""Hypotheses whose likelihood on all blocks is kept: many candidates are compared with the same one."""


@dataclass(frozen=True)
class LikelihoodComparison:
    """How much likelier one hypothesis makes the snapshots than another one.

    Attributes:
        nats: difference of the log-likelihood as computed; the prior is only roughly right, so that it is not to be
            taken at face value.
        z: standard normal number that is exceeded as often by chance: Wilcoxon's signed ranks of the tiles.
        agree: how many snapshots prefer the first hypothesis.
        snapshots: of how many.
        p_snapshots: probability that chance alone makes the snapshots prefer the first hypothesis so clearly, by
            Wilcoxon's signed ranks of the snapshots themselves.
    """

    nats: float
    z: float
    agree: int
    snapshots: int
    p_snapshots: float = 1.0

    @property
    def calibrated(self) -> float:
        """Nats at which a right prior would have been as sure: a difference of d nats then has the variance 2 d."""
        return math.copysign(min(abs(self.nats), 2 * self.z**2), self.nats)

    @property
    def snapshots_prefer(self) -> bool:
        """Whether the snapshots themselves prefer the first hypothesis.

        Three or four have to be unanimous; fewer do not tell.
        """
        by_chance = max(MAX_P_SNAPSHOTS, 0.5**self.snapshots)
        return self.nats > 0 and self.snapshots >= MIN_SNAPSHOTS and self.p_snapshots <= by_chance

    @property
    def p_value(self) -> float:
        """Probability that chance alone prefers the first hypothesis so clearly, paired over tiles of blocks."""
        return float(norm.sf(self.z))


def compare(first: torch.Tensor, second: torch.Tensor, columns: int) -> LikelihoodComparison:
    """Compare two hypotheses on the blocks that count for both.

    How much a tile gains differs by orders of magnitude between dark and bright, even and textured places. Ranks do
    not depend on that.

    Args:
        first, second: log-likelihoods ``(blocks, N)``, NaN where a block does not count.
        columns: of blocks.
    """
    difference = (first - second).nan_to_num(0.0)
    by_snapshot, by_tile = difference.sum(0), tiles(difference[None], columns)[0]
    by_tile = by_tile[by_tile != 0]
    z = 0.0
    if len(by_tile) >= 2:
        sides = [wilcoxon(by_tile.numpy(), alternative=side).pvalue for side in ("greater", "less")]
        z = float(norm.isf(max(sides[0], 1e-300)) if sides[0] < sides[1] else -norm.isf(max(sides[1], 1e-300)))
    differing = by_snapshot[by_snapshot != 0]
    by_chance = float(wilcoxon(differing.numpy(), alternative="greater").pvalue) if len(differing) else 1.0
    return LikelihoodComparison(float(by_snapshot.sum()), z, int((differing > 0).sum()), len(differing), by_chance)


@dataclass(frozen=True)
class MaskEvidence:
    """What the snapshots say for the mask: the likeliest camera is compared with one without any mask.

    Attributes:
        gained: nats per pixel that the likeliest camera gains over the ideal one.
        gained_without: the same of a camera whose mask is the same everywhere.
        needed: nats per pixel that a camera without any mask must lack, as the prior of the scenes is not better known.
        distinct: whether the snapshots distinguish the likeliest camera from that.
    """

    gained: float
    gained_without: float
    needed: float
    distinct: bool

    @property
    def visible(self) -> bool:
        """Whether the snapshots are likelier with the mask than with none."""
        return self.gained > self.gained_without

    @property
    def decides(self) -> bool:
        """Whether a camera without any mask does not explain nearly as much as the likeliest one."""
        return self.distinct and self.gained - self.gained_without >= self.needed


@dataclass(frozen=True)
class FittedCandidate:
    """An effect that was fitted beside a model.

    Attributes:
        name: of the effect.
        fit: of the model with it.
        comparison: with the model without it.
        nats: calibrated nats that it gains.
        gain: the same beyond the penalty for its parameters.
        like_a_scene: whether it changes the image as a scene of another kind would.
        possible: False if the fit leaves less light than none in the darkest pixels.
    """

    name: str
    fit: BlindFit
    comparison: LikelihoodComparison
    nats: float
    gain: float
    like_a_scene: bool = False
    possible: bool = True

    @property
    def clear(self) -> bool:
        """Whether the effect is so well supported that it may be named."""
        return self.supported and (self.comparison.z > MIN_Z or self.nats >= AMPLE_NATS)

    @property
    def supported(self) -> bool:
        """Whether the effect would be kept if it had been named."""
        comparison = self.comparison
        agree = comparison.agree >= MIN_SUPPORT * comparison.snapshots
        if self.like_a_scene:  # errors of the prior look like it all over a snapshot: its blocks do not tell
            agree = agree and comparison.snapshots_prefer
        return self.possible and agree and self.gain > 0 and comparison.z > KEPT_MIN_Z


class CandidateAssessor:
    """Judges what speaks for an effect of a fitted model against the same model without it.

    Args:
        fitter: of the models.
        blocks: ``(blocks,)`` bool, all blocks that count; models are fitted to fewer.
        min_gain_nats: what an effect must gain beyond the penalty for its parameters.
    """

    def __init__(self, fitter: BlindFitter, blocks: torch.Tensor, min_gain_nats: float) -> None:
        self.fitter, self.blocks, self.min_gain_nats = fitter, blocks, min_gain_nats
        self._scores: Recent[torch.Tensor] = Recent(HYPOTHESES_CACHED)

    def __call__(self, fit: BlindFit, without: BlindFit, name: str) -> FittedCandidate:
        """Return an effect of a fit with what speaks for it.

        Snapshots have to agree about an effect that looks like a scene of another kind, and the few blocks that are
        fitted say little about one snapshot: they are compared on all blocks. The nats are those of the fitted blocks,
        which the penalty is for. Such an effect is refused if it leaves less light than none where it is darkest. Of
        a mixture of slots only that counts which no motion does: it is compared with scenes that move less.

        Args:
            fit: of the model with the effect.
            without: the fitted model without it.
            name: of the effect.
        """
        columns, fitter = self.fitter.likelihood.columns, self.fitter
        comparison = compare(fit.log_likelihood, without.log_likelihood, columns)
        like_a_scene, possible = self.is_like_a_scene(name), True
        if name in SHOWN_IF_STRONG and comparison.z > KEPT_MIN_Z:
            slower = self._of_slower_scenes.fit(fit.hypothesis, fit.blocks, SLOWER_ITERATIONS, errors=False)
            direct = compare(fit.log_likelihood, slower.log_likelihood, columns)
            if direct.nats < comparison.nats:
                without, comparison, fitter = slower, direct, self._of_slower_scenes
        if like_a_scene and comparison.nats > 0:
            on_all = compare(self._score(fit, self.fitter), self._score(without, fitter), columns)
            comparison = replace(on_all, nats=comparison.nats)
            possible = self._is_possible(fit, without, name)
        nats = self.nats(fit, name, comparison)
        gain = nats - price(fit, without) - self.min_gain_nats
        return FittedCandidate(name, fit, comparison, nats, gain, like_a_scene, possible)

    @cached_property
    def _of_slower_scenes(self) -> BlindFitter:
        """Fits what scenes that move less look like, in the place of effects that mix slots and under their names."""
        model, likelihood = self.fitter.model, self.fitter.likelihood
        slower = {name: slower_scenes(effect) for name, effect in model.vocabulary.items() if name in SHOWN_IF_STRONG}
        model = CameraModel(model.observation, model.vocabulary | slower, model.free_forms)
        return BlindFitter(BlindLikelihood(model, likelihood.prior))

    def nats(self, fit: BlindFit, name: str, comparison: LikelihoodComparison) -> float:
        """Return the calibrated nats that an effect of a fit gains: no more than as snapshots agree about it."""
        much = comparison.nats >= AMPLE_NATS and comparison.z > KEPT_MIN_Z and not self.is_like_a_scene(name)
        nats = max(comparison.calibrated, AMPLE_NATS) if much else comparison.calibrated
        return min(nats, self.fitter.distance(fit, name))

    def snapshots_prefer(self, fit: BlindFit, rival: BlindFit) -> bool:
        """Return whether the snapshots themselves prefer a fit to a rival, by all blocks of each.

        Args:
            fit: with an effect that is named.
            rival: with an effect in its place that looks like a scene of another kind.
        """
        mine, other = (self._score(one, self.fitter) for one in (fit, rival))
        return compare(mine, other, self.fitter.likelihood.columns).snapshots_prefer

    def is_like_a_scene(self, name: str) -> bool:
        """Return whether an effect changes the image as a scene of another kind would, and not that of the mask."""
        of_the_mask = issubclass(self.fitter.model.vocabulary[name], (ModulatorEffect, RelayEffect))
        return not of_the_mask or name in SHOWN_IF_STRONG

    def _is_possible(self, fit: BlindFit, without: BlindFit, name: str) -> bool:
        """Return whether an effect leaves light in the darkest pixels, as far as the noise and its own error tell.

        What other effects of the model take away is not its fault, and nothing is impossible where the datasheet does
        not state how far the noise reaches.
        """
        if self.fitter.model.observation.read_noise is None:
            return True
        below = self.fitter.likelihood.below_no_light
        weakest = self.fitter.weakened(fit, name, WEAKENED_BY_SIGMA)
        return below(weakest) < DARKEST_SIGMA or below(without.hypothesis) >= DARKEST_SIGMA

    def _score(self, fit: BlindFit, fitter: BlindFitter) -> torch.Tensor:
        """Return the log-likelihood ``(blocks, N)`` on all blocks of a hypothesis that a fitter has fitted."""
        if not bool((self.blocks & ~fit.blocks).any()):
            return fit.log_likelihood
        key = (fitter is self.fitter, *((name, *setting.items()) for name, setting in fit.hypothesis.effects.items()))
        return self._scores.get(key, lambda: fitter.evaluate(fit.hypothesis, self.blocks).log_likelihood)
