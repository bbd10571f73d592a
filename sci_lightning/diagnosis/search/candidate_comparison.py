"""One round of the search: candidates are screened, the best are fitted, and all are compared on the same pixels.

What lies beyond the patterns may be unknown. A pixel whose value depends on it, by any of the hypotheses that are
compared, counts for none of them. Once the search has decided, every pixel counts that its result can predict.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import ABANDON_NATS, bic_gain, bic_penalty
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.search.map_test import has_mean
from sci_lightning.diagnosis.search.probability import evidence_for
from sci_lightning.diagnosis.search.remaining_misfit import contradicted_maps
from sci_lightning.diagnosis.search.screening import Candidate, screen
from sci_lightning.encoder.effects.parameter import part_of

MIN_LOST_SHARE = 0.1
"""Part of the pixels whose loss is worth a second look, for weak effects, which need narrower borders."""
SCREENED_SHARE = 0.33
"""Part of the nats that an effect must gain which screening must promise for a joint fit to be made; screening finds at
least half of what a fit gains, even between two starts of a flicker."""
BORDER_GAIN_SHARE = 0.5
"""Part of the best candidate's gain from which a candidate's border is respected; a hypothesis that needs the surround
gains too little while its border is too narrow."""


@dataclass(frozen=True)
class CandidateComparison:
    """The candidates of one round, fitted.

    Attributes:
        screener: leaves out what depends on the unknown surround for any candidate at its starts.
        best: the model without the candidates; its fitter leaves out what depends on the surround for any of the fits
            that gain much.
        fits: the model with each candidate that was fitted, by name, on the same pixels; what cannot catch up with
            another one is abandoned.
        screened: all candidates, the most promising first.
    """

    screener: Fitter
    best: Fit
    fits: Mapping[str, Fit]
    screened: tuple[Candidate, ...]

    def gains(self) -> dict[str, tuple[float, float]]:
        """Return the nats that each fit gained, by name: on all pixels, and on held-out ones."""
        return {
            name: (
                fit.log_likelihood - self.best.log_likelihood,
                fit.held_out_log_likelihood - self.best.held_out_log_likelihood,
            )
            for name, fit in self.fits.items()
        }

    def winner(self) -> str | None:
        """Return the candidate of the largest gain by the information criterion; None if none gains."""
        enough = [name for name, gain in self._bic_gains.items() if gain > 0]
        return max(enough, key=self._bic_gains.__getitem__, default=None)

    def most_probable(self, imitating: bool = False, least: float = 0.0) -> str | None:
        """Return the candidate of the largest gain among those that are more probable than not; None if there is none.

        What clusters of pixels disagree about is not counted (:mod:`~sci_lightning.diagnosis.search.probability`).

        Args:
            imitating: whether it may be a map that is not what its name says.
            least: logarithm of the odds that it must exceed; 0 for more probable than not.
        """
        ranked = sorted((name for name, gain in self._bic_gains.items() if gain > 0), key=self._bic_gains.__getitem__)
        probable = (n for n in reversed(ranked) if evidence_for(self.fits[n], n, without=self.best).log_odds > least)
        return next((name for name in probable if imitating or not self._imitates(name)), None)

    def _imitates(self, name: str) -> bool:
        """Return whether the map of a candidate is not what its name says, if it has one."""
        fit = self.fits[name]
        return name in fit.maps and (has_mean(fit.maps[name]) or name in contradicted_maps(fit))

    def probabilities(self) -> dict[str, float]:
        """Return how probable each candidate is that gained anything, by name."""
        gained = {name: fit for name, fit in self.fits.items() if fit.log_likelihood > self.best.log_likelihood}
        return {name: evidence_for(fit, name, without=self.best).probability for name, fit in gained.items()}

    def with_others(self, refused: Collection[str]) -> CandidateComparison:
        """Return a comparison of the most promising ones among the candidates that have not been refused."""
        others = [candidate for candidate in self.screened if candidate.name not in refused]
        fits = fit_candidates(self.best, others)
        return CandidateComparison(self.screener, *_with_common_border(self.best, fits), self.screened)

    def gain_of(self, name: str | None) -> float:
        """Return the gain of a candidate by the information criterion, in nats; 0 of None."""
        return 0.0 if name is None else self._bic_gains[name]

    def leaves_out_much(self, whole: Fitter) -> bool:
        """Whether many of the pixels that the model without the candidates predicts count for none of them."""
        return self.best.fitter.pixels < (1 - MIN_LOST_SHARE) * whole.covering(self.best.hypothesis).pixels

    @cached_property
    def _bic_gains(self) -> dict[str, float]:
        """Gains by name; of two effects that are the same, the one that is not plainer has to gain clearly more."""
        effects, present = self.best.fitter.model.effects, (*self.fits, *self.best.hypothesis.effects)
        more, gains = self.best.fitter.settings.indistinct_nats, dict[str, float]()
        for name, fit in self.fits.items():
            gains[name] = bic_gain(self.best, fit) - (more if effects[name].plainer in present else 0.0)
        return gains


def compare_candidates(
    best: Fit, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0
) -> CandidateComparison:
    """Screen all candidates, fit the most promising ones, and compare them on the same pixels.

    An effect must not be screened by pixels that its formula cannot know: what depends on the surround for any
    candidate at its starts is left out before.

    Args:
        best: the model without the candidates.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    base = covering_starts(best.fitter, best.hypothesis, further, part).repeated(best)
    screened = screen(base, further, part)
    fits = fit_candidates(base, screened)
    return CandidateComparison(base.fitter, *_with_common_border(base, fits), tuple(screened))


def covering_starts(
    fitter: Fitter, hypothesis: Hypothesis, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0
) -> Fitter:
    """Return a fitter that leaves out what depends on the surround for any candidate at its starts.

    Args:
        fitter: of the captures.
        hypothesis: the model without the candidates.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    model, seen = fitter.model, fitter.model.observation
    return fitter.covering(
        hypothesis,
        *(
            hypothesis.with_effect(name, part_of(start, effect.about, part))
            for name, effect in model.vocabulary.items()
            if name not in hypothesis.effects and not effect.noise and not effect.map_kind
            for start in [*effect.starts(seen.frames, seen.size, seen.bit_depth), *(further or {}).get(name, [])]
        ),
    )


def fit_candidates(best: Fit, screened: list[Candidate]) -> dict[str, Fit]:
    """Fit the most promising candidates jointly with everything in the model, by name.

    A candidate whose screened gain is a small part of what it must gain is left out, and so is one whose fit cannot
    reach what another one has reached that is worth its parameters. Effects that are chosen from a few values, such as
    turned patterns, are fitted wherever they stand: nothing leads to them step by step, and blurs and displacements may
    promise more as long as the noise stands in for them all.

    Args:
        best: the model without them.
        screened: candidates, the most promising first.
    """
    fitter = best.fitter
    settings, fits, reached = fitter.settings, dict[str, Fit](), -math.inf
    first, others = screened[: settings.candidates_fitted], screened[settings.candidates_fitted :]
    for candidate in (*first, *(one for one in others if fitter.model.effects[one.name].is_discrete())):
        price = settings.min_gain_nats + bic_penalty(len(candidate.start), fitter.pixels)
        promising = candidate.gain > max(settings.min_gain_nats, SCREENED_SHARE * price)
        if promising and (not fits or fitter.budget.allows(candidate.name)):
            start = candidate.added(fitter.model, best.hypothesis)
            fit = fitter.fit(start, 20, to_reach=reached - ABANDON_NATS, from_afar=True)
            if not fit.abandoned:
                fits[candidate.name] = fit
                if bic_gain(best, fit) > 0:
                    reached = max(reached, fit.fitted_log_likelihood)
    return fits


def _with_common_border(base: Fit, fits: dict[str, Fit]) -> tuple[Fit, dict[str, Fit]]:
    """Return the fits of a round on the pixels that depend on the surround for none of them.

    Only fits that gain at least ``BORDER_GAIN_SHARE`` of what the best one gains are respected; the
    others may have run away, and the field would be left out for nothing. Fits that are repeated on fewer pixels may
    need a wider border themselves, so that this is done until none does.
    """
    while fits:
        gains = {name: fit.log_likelihood - base.log_likelihood for name, fit in fits.items()}
        least = BORDER_GAIN_SHARE * max(gains.values())
        respected = [fit.hypothesis for name, fit in fits.items() if gains[name] >= least]
        wider = base.fitter.covering(base.hypothesis, *respected)
        if wider is base.fitter:
            break
        base, fits = wider.repeated(base), {name: wider.repeated(fit) for name, fit in fits.items()}
    return base, fits
