"""The search for missing effects in snapshots of unknown scenes: screening, joint fits, competition and pruning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter, price, price_of
from sci_lightning.diagnosis.blind.candidate_comparison import (
    AMPLE_NATS,
    KEPT_MIN_Z,
    MIN_Z,
    CandidateAssessor,
    FittedCandidate,
    LikelihoodComparison,
    MaskEvidence,
    compare,
)
from sci_lightning.diagnosis.blind.displacement import first_pose
from sci_lightning.diagnosis.blind.likelihood import spread
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.blind.same_patterns import SamePatterns
from sci_lightning.diagnosis.blind.screening import FINAL_ITERATIONS, STARTS_FITTED, ScreenedCandidate, Screener
from sci_lightning.diagnosis.blind.undetermined import determined_effects
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.search_settings import SearchSettings

OnProgress = Callable[[str], None]
"""Called with a one-line message after every step of the search."""

FITTED_BLOCKS = 128
"""Blocks to which candidates are fitted."""
CANDIDATE_PROGRESS_NATS = 0.5
"""Nats below which the fit of a candidate has converged: what decides about it are tens."""
PROMISING_SHARE = 0.1
"""Part of the best candidate's nats that another one must gain, fitted by itself, to be fitted beside all others."""
JOINT_GAIN_FACTOR = 2.0
"""Times as much as by itself a candidate may gain once the other effects are fitted again: if even that does not pay
for its parameters, it is not fitted."""
RIVAL_SHARE = 0.3
"""Part of an effect's nats that another one must gain in its place, fitted by itself, to be a rival."""
FITTED_WITH_POSE: dict[str, Setting] = {"mask_blur": {"sigma": 0.7}, "black_level": {"offset": 0.02}}
"""What is fitted beside the first pose of the mask's image, and from where: either lowers the contrast with which the
mask is seen, and a search for one effect at a time takes wrong ones for what it has not found yet."""
FIRST_POSE_RIVALS = {"mask_scale": "mask_distortion", "black_level": "mask_contrast"}
"""What the search begins with as the first of two effects may be the second one. Parts of a field do not show a
distortion as such; of a black level and a leak, fitted together, pruning would drop whichever it tests first."""
DISTINCT_Z = 3.0
"""Standard deviations below which two hypotheses are not distinguished."""


@dataclass(frozen=True)
class NamedCandidate:
    """An effect that the search named, with what speaks for it.

    Attributes:
        name: of the effect.
        comparison: of the final model with the same without it.
        nats: calibrated nats that it gains.
        penalty: nats that its parameters cost.
        shares: of itself and of the effects that explain the snapshots as well in its place, by name; sum 1.
    """

    name: str
    comparison: LikelihoodComparison
    nats: float
    penalty: float
    shares: dict[str, float]

    @property
    def most_likely(self) -> str:
        """The effect with the largest share, itself where several have it."""
        return max(self.shares, key=lambda name: self.shares[name])

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Effects that explain the snapshots as well in its place."""
        return tuple(name for name in self.shares if name != self.name)


@dataclass(frozen=True)
class BlindExplanation:
    """What the search found.

    Attributes:
        ideal: the ideal camera.
        fit: the final model.
        named: its effects, in the order in which light meets them; nothing where no mask is to be seen.
        rounds: calibrated nats of the candidates that were fitted, by name, round by round.
        mask: what the snapshots say for the mask itself.
    """

    ideal: BlindFit
    fit: BlindFit
    named: tuple[NamedCandidate, ...]
    rounds: tuple[dict[str, float], ...]
    mask: MaskEvidence


class BlindSearch:
    """Searches for the effects that snapshots of unknown scenes support.

    Args:
        fitter: fits hypotheses.
        noise: the ideal camera with its noise.
        settings: thresholds and budgets.
        on_progress: called with a one-line message after every step.
        calibration: effects that every model has, and where their fit starts: what nobody knows of a measured mask.
    """

    def __init__(
        self,
        fitter: BlindFitter,
        noise: Hypothesis,
        settings: SearchSettings,
        on_progress: OnProgress,
        calibration: Mapping[str, Setting] = MappingProxyType({}),
    ) -> None:
        self.fitter, self.noise, self.settings, self.on_progress = fitter, noise, settings, on_progress
        self.calibrated = Hypothesis({**noise.effects, **calibration})
        likelihood = fitter.likelihood
        self.columns = likelihood.columns
        self.all_blocks = likelihood.usable.any(1)
        self.fitted_blocks = spread(self.all_blocks, FITTED_BLOCKS)
        names = [name for name in determined_effects(fitter.model) if name not in self.calibrated.effects]
        self.patterns = SamePatterns(likelihood, self.calibrated, names)
        self.candidates = [name for name in names if name not in self.patterns.idle]
        self._every_scene = likelihood
        self._use(fitter)
        self._promising: set[str] = set()

    def _use(self, fitter: BlindFitter) -> None:
        """Compare hypotheses by the likelihood of a fitter from now on; what was compared by another one is void."""
        self.fitter, settings = fitter, self.settings
        self.screener = Screener(fitter, self.fitted_blocks, settings.border_share, self.patterns.replaced)
        self.assessor = CandidateAssessor(fitter, self.all_blocks, settings.min_gain_nats)
        self._fitted_candidates: dict[frozenset[str], list[FittedCandidate]] = {}

    def _of_these_scenes(self, best: BlindFit) -> BlindFit:
        """Go on with the components of the prior that these scenes are made of by a model; return the model anew."""
        every = self._every_scene
        prior = every.prior.of_these_scenes(every.evaluate(best.hypothesis, self.screener.blocks).weights)
        self._use(BlindFitter(every.with_prior(prior)))
        again = self.fitter.evaluate(best.hypothesis, best.blocks)
        return replace(again, free=best.free, covariance=best.covariance)

    def run(self) -> BlindExplanation:
        """Find the most likely model: forward selection, pruning, and what else would explain the snapshots."""
        start = self._of_these_scenes(self.fitter.evaluate(self.noise, self.fitted_blocks))
        if self.calibrated != self.noise:
            start = self.fitter.fit(self.calibrated, self.fitted_blocks)
            self.calibrated = start.hypothesis
        best = self._posed(start)
        rounds = []
        for _ in range(self.settings.max_effects):  # pruning may drop what an earlier round added: rounds are bounded
            fitted = self.fitted_candidates(best)
            rounds.append({one.name: one.nats for one in fitted})
            winner = self._winner(fitted)
            if winner is None or len(self._deviations(best)) >= self.settings.max_effects:
                break
            self.on_progress(f"{winner.name}: {winner.nats:.0f} nats")
            best = self.prune(winner.fit)
            if winner.name not in best.hypothesis.effects:  # the same would be added again
                break
            best = self._of_these_scenes(best)
        ideal = BlindFitter(self._every_scene).evaluate(self.noise, self.all_blocks)
        mask = self._mask_evidence(best, ideal)
        if not mask.visible:
            return BlindExplanation(ideal, ideal, (), tuple(rounds), mask)
        named: tuple[NamedCandidate, ...] = ()
        # A name was chosen when less was known of the scenes: another one of its class may be the likeliest by now.
        for _ in range(2):
            for one in named:
                best = self._exchanged(best, one.name, one.most_likely) if one.most_likely != one.name else best
            best = self.fitter.fit(best.hypothesis, self.all_blocks, iterations=FINAL_ITERATIONS, rough=False)
            named = self.evidence(best)
            if all(one.most_likely == one.name for one in named):
                break
        in_every_scene = self._every_scene.evaluate(best.hypothesis, best.blocks).log_likelihood
        return BlindExplanation(ideal, replace(best, log_likelihood=in_every_scene), named, tuple(rounds), mask)

    def _mask_evidence(self, best: BlindFit, ideal: BlindFit) -> MaskEvidence:
        """Compare the likeliest camera with the same one without any mask, and both with the ideal one."""
        even = best.hypothesis.with_effect("mask_contrast", {"leak": 1.0})
        with_mask, without = (
            self._every_scene.evaluate(one, best.blocks).log_likelihood for one in (best.hypothesis, even)
        )
        gained, gained_without = (
            float((one - ideal.log_likelihood).nanmean()) / BLOCK**2 for one in (with_mask, without)
        )
        distinct = self._is_distinguished(compare(with_mask, without, self.columns))
        return MaskEvidence(gained, gained_without, self._every_scene.prior.uncertainty_nats, distinct)

    def _posed(self, ideal: BlindFit) -> BlindFit:
        """Return the camera in which the search of a large field begins: the given one, and what parts of it show.

        The pose of the mask's image that the parts show is fitted together with what hides it from a search for one
        effect at a time (:data:`FITTED_WITH_POSE`), and what has no support is dropped. What is left gives way to an
        effect that is much like it and makes the snapshots likelier (:data:`FIRST_POSE_RIVALS`).
        """
        pose = first_pose(self.fitter.likelihood, self.calibrated, self.settings.border_share)
        begun = {name: setting for name, setting in {**pose, **FITTED_WITH_POSE}.items() if name in self.candidates}
        if not pose or not pose.keys() <= begun.keys():
            return ideal
        hypothesis = self.calibrated
        for name, setting in begun.items():
            hypothesis = hypothesis.with_effect(name, setting)
        fit = self.prune(self.fitter.fit(hypothesis, self.fitted_blocks, enough=CANDIDATE_PROGRESS_NATS))
        names = self._deviations(fit)
        if not pose.keys() & set(names) or len(names) > self.settings.max_effects:
            return ideal  # what is beside the pose needs support by itself
        # Where there is nothing beside it, pruning compared it with nothing.
        if len(names) == 1 and not self.assessor(fit, ideal, names[0]).clear:
            return ideal
        for name, other in FIRST_POSE_RIVALS.items():
            if name in fit.hypothesis.effects and other in self.candidates:
                fit = self._exchanged(fit, name, other)
        names = self._deviations(fit)
        self._promising |= set(names)
        self.on_progress(f"parts of the field show {', '.join(names)}")
        return fit

    def _exchanged(self, fit: BlindFit, name: str, other: str) -> BlindFit:
        """Return the model with another effect in the place of one if the snapshots prefer it, else the model."""
        without = self.fitter.fit(fit.hypothesis.without(name), fit.blocks, FINAL_ITERATIONS, errors=False)
        for rival in self._fitted(without, 1, 1, names=[other], ahead=fit):
            direct = compare(rival.fit.log_likelihood, fit.log_likelihood, self.columns)
            if direct.nats > price(rival.fit, fit):
                return self.prune(rival.fit)  # what had support beside the one may have none beside the other
        return fit

    def fitted_candidates(self, base: BlindFit) -> list[FittedCandidate]:
        """Screen every candidate beside a model and fit the most promising; the best comes first.

        Candidates beside a model with the same effects are remembered, wherever its parameters were.
        """
        key = frozenset(base.hypothesis.effects)
        if key not in self._fitted_candidates:
            self._fitted_candidates[key] = self._fitted(base, self.settings.candidates_fitted, STARTS_FITTED)
        return self._fitted_candidates[key]

    def rivals(self, base: BlindFit, least: float, ahead: BlindFit) -> list[FittedCandidate]:
        """Return what might stand in the place of an effect that a model lacks: fewer candidates and starts are fitted.

        The candidates of a round of the search are taken where there was one with this model, else those that were
        among the most promising in any round.

        Args:
            base: the model without the effect.
            least: nats on the screened blocks that a rival must gain by itself.
            ahead: the model with the effect, which rivals have to catch up with.
        """
        known = self._fitted_candidates.get(frozenset(base.hypothesis.effects))
        if known is not None:
            return known
        return self._fitted(base, 1 + self.settings.rivals_fitted, 1, least, sorted(self._promising), ahead)

    def _fitted(
        self,
        base: BlindFit,
        count: int,
        starts: int,
        least: float = 0.0,
        names: Sequence[str] | None = None,
        ahead: BlindFit | None = None,
    ) -> list[FittedCandidate]:
        """Fit the most promising candidates beside all effects of a model; the best comes first.

        Args:
            base: the model.
            count: candidates that are fitted at most.
            starts: of each of them.
            least: nats on the screened blocks that a candidate must gain by itself.
            names: of the candidates; None for all.
            ahead: a model that they have to catch up with; None for none.
        """
        asked = self.candidates if names is None else names
        named = base.hypothesis.effects.keys()
        twice = {name for name in asked if self.patterns.same[name] & named}  # another one of them is named
        screened = self.screener.screen(base, [name for name in asked if name not in twice], count, starts)
        self._promising |= {one.name for one in screened if one.promising}
        screened = self._one_of_a_kind([one for one in screened if one.nats > 0])
        least = max(least, PROMISING_SHARE * screened[0].nats) if screened else least
        more = float(self.fitted_blocks.sum() / self.screener.blocks.sum())  # times as many blocks are fitted
        blocks = int(base.log_likelihood.isfinite().sum())
        kept = [
            one
            for one in screened
            if one.nats >= least and JOINT_GAIN_FACTOR * more * one.nats >= price_of(len(one.start), blocks)
        ]
        fitted = on_every_core(
            lambda one: self._fitted_candidate(base, one.name, one.start, ahead),
            kept[:count],
            self.fitter.likelihood.at_a_time,
        )
        return sorted(fitted, key=lambda one: -one.gain)

    def _one_of_a_kind(self, screened: list[ScreenedCandidate]) -> list[ScreenedCandidate]:
        """Return, of candidates that do the same to these patterns, the first one only."""
        kept: list[ScreenedCandidate] = []
        for one in screened:
            if not self.patterns.same[one.name] & {other.name for other in kept}:
                kept.append(one)
        return kept

    def _fitted_candidate(self, base: BlindFit, name: str, start: Setting, ahead: BlindFit | None) -> FittedCandidate:
        hypothesis = base.hypothesis.with_effect(name, start)
        behind = None if ahead is None else ahead.log_likelihood
        fit = self.fitter.fit(hypothesis, self.fitted_blocks, enough=CANDIDATE_PROGRESS_NATS, ahead=behind)
        return self.assessor(fit, base, name)

    def _winner(self, fitted: list[FittedCandidate]) -> FittedCandidate | None:
        """Return the effect that is named next; None if there is none.

        It is the clear one that all others are compared with in vain, beyond what their parameters cost. Another one
        may make the snapshots likelier, leave nothing to it and have support, if less than a name needs: what is
        clear is then that one of the two is there, and the likelier one is named.
        """
        clear = [one for one in fitted if one.clear]
        if not clear:
            return None
        best = clear[0]
        for other in clear[1:]:
            direct = compare(other.fit.log_likelihood, best.fit.log_likelihood, self.columns)
            if direct.nats > price(other.fit, best.fit):
                best = other
        better = [one for one in fitted if one.supported and not one.clear and self._replaces(one, best)]
        return max(better, key=lambda one: one.comparison.nats, default=best)

    def _replaces(self, other: FittedCandidate, one: FittedCandidate) -> bool:
        """Return whether another candidate makes the snapshots likelier than one, which it makes superfluous."""
        if compare(other.fit.log_likelihood, one.fit.log_likelihood, self.columns).nats <= 0:
            return False
        both = other.fit.hypothesis.with_effect(one.name, one.fit.hypothesis.effects[one.name])
        fit = self.fitter.fit(both, other.fit.blocks, FINAL_ITERATIONS, errors=False)
        return compare(fit.log_likelihood, other.fit.log_likelihood, self.columns).z < MIN_Z

    def _is_distinguished(self, comparison: LikelihoodComparison) -> bool:
        """Return whether a model is so much likelier than one with another effect that the two are distinguished.

        A rival that blurs the mask away leaves few blocks to be compared, which may tell much.
        """
        sure = comparison.z >= DISTINCT_Z or (comparison.nats >= AMPLE_NATS and comparison.z > KEPT_MIN_Z)
        return sure and comparison.calibrated >= self.settings.indistinct_nats

    def _deviations(self, fit: BlindFit) -> list[str]:
        """Return the effects of a model beside noise and calibration."""
        return [name for name in fit.hypothesis.effects if name not in self.calibrated.effects]

    def prune(self, fit: BlindFit) -> BlindFit:
        """Drop every effect that has no support beside the others."""
        names = self._deviations(fit)
        for name in names if len(names) > 1 else []:
            without = self.fitter.fit(fit.hypothesis.without(name), fit.blocks, FINAL_ITERATIONS)
            if not self.assessor(fit, without, name).supported:
                fit = without
        return fit

    def evidence(self, fit: BlindFit) -> tuple[NamedCandidate, ...]:
        """Return what speaks for every effect of a model, and what might stand in its place."""
        on_fitted = self.fitter.evaluate(fit.hypothesis, self.fitted_blocks).log_likelihood
        fit = replace(fit, log_likelihood=on_fitted, blocks=self.fitted_blocks)
        effects = self.fitter.model.effects
        names = self._deviations(fit)
        named = []
        for name in sorted(names, key=lambda one: effects[one].rank):
            without = self.fitter.fit(fit.hypothesis.without(name), self.fitted_blocks, FINAL_ITERATIONS, errors=False)
            one, cost = self.assessor(fit, without, name), price(fit, without)
            on_screened = (fit.log_likelihood - without.log_likelihood)[self.screener.blocks].nan_to_num(0.0)
            lacks = {name: 0.0} | dict.fromkeys(self.patterns.chosen(name, fit.hypothesis.effects[name]), 0.0)
            same = self.patterns.continuous(name)
            alike = self._fitted(without, len(same), 1, names=same, ahead=fit) if same else []
            for rival in [*self.rivals(without, RIVAL_SHARE * float(on_screened.sum()), fit), *alike]:
                direct = compare(fit.log_likelihood, rival.fit.log_likelihood, self.columns)
                if rival.name in lacks or not rival.possible:
                    continue
                if not self._is_distinguished(direct) or (
                    rival.like_a_scene and not self.assessor.snapshots_prefer(fit, rival.fit)
                ):
                    lacks[rival.name] = direct.calibrated
            likely = (-torch.tensor(list(lacks.values()))).softmax(0).tolist()
            named.append(NamedCandidate(name, one.comparison, one.nats, cost, dict(zip(lacks, likely, strict=True))))
        return tuple(named)
