"""One round of the search: candidates are screened, the best are fitted, and all are compared alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import bic, bic_gain
from sci_lightning.diagnosis.model.camera_model import Setting
from sci_lightning.diagnosis.search.border_choice import with_border_for_candidates, with_border_for_starts
from sci_lightning.diagnosis.search.screening import Candidate, screen

NEAR = 0.1
"""Part of a start's distance from doing nothing at which weak effects are looked for."""
MUCH = 0.1
"""Part of the pixels whose loss is worth a second look, for weak effects, which need less room at the sides."""


@dataclass(frozen=True)
class CandidateComparison:
    """The candidates of one round, fitted.

    Attributes:
        screener: leaves out what depends on the unknown surround for any candidate at its starts.
        fitter: leaves out what depends on it for any of the fits that gain much.
        best: the model without the candidates.
        fits: the model with each candidate that was fitted, by name.
        screened: all candidates, the most promising first.
    """

    screener: Fitter
    fitter: Fitter
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

    def winner(self, least: float) -> str | None:
        """Return the candidate of the largest gain by the information criterion; None if no gain exceeds ``least``."""
        enough = [name for name, gain in self._bic_gains.items() if gain > least]
        return max(enough, key=self._bic_gains.__getitem__, default=None)

    def gain_of(self, name: str | None) -> float:
        """Return the gain of a candidate by the information criterion, in nats; 0 of None."""
        return 0.0 if name is None else self._bic_gains[name]

    def refused(self, least: float) -> str | None:
        """Return the candidate of the largest gain among those that held-out pixels do not confirm.

        None if no gain exceeds ``least``.
        """
        refused = [name for name, gain in self._bic_gains.items() if gain == -math.inf]
        before = bic(self.fitter, self.best)
        gains = {name: bic(self.fitter, self.fits[name]) - before - self._handicap[name] for name in refused}
        return max((name for name in refused if gains[name] > least), key=gains.__getitem__, default=None)

    def leaves_out_much(self, whole: Fitter) -> bool:
        """Whether many of the pixels that the model without the candidates predicts count for none of them."""
        return self.fitter.pixels < (1 - MUCH) * whole.covering(self.best.hypothesis).pixels

    @cached_property
    def _bic_gains(self) -> dict[str, float]:
        return {name: bic_gain(self.fitter, self.best, fit) - self._handicap[name] for name, fit in self.fits.items()}

    @cached_property
    def _handicap(self) -> dict[str, float]:
        """Nats taken off: an effect that is the same as a plainer one is named only where captures tell them apart."""
        effects, present = self.fitter.model.effects, (*self.fits, *self.best.hypothesis.effects)
        plainer = {name for name in self.fits if effects[name].plainer in present}
        return {name: self.fitter.settings.indistinct_nats if name in plainer else 0.0 for name in self.fits}


def compare_candidates(
    fitter: Fitter, best: Fit, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0
) -> CandidateComparison:
    """Screen all candidates, fit the most promising ones, and compare them on the same pixels.

    Args:
        fitter: fits hypotheses to the captures.
        best: the model without the candidates.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    screener, base = with_border_for_starts(fitter, best, further, part)
    screened = screen(screener, base, further, part)
    fits = fit_candidates(screener, base, screened)
    return CandidateComparison(screener, *with_border_for_candidates(screener, base, fits), tuple(screened))


def fit_candidates(fitter: Fitter, best: Fit, screened: list[Candidate]) -> dict[str, Fit]:
    """Fit the most promising candidates jointly with everything in the model, by name.

    A candidate whose screened gain is a small part of what it must gain is left out, and so is one whose fit cannot
    reach what another one has reached. Effects that are chosen from a few values, such as turned patterns, are fitted
    wherever they stand: nothing leads to them step by step, and blurs and displacements may promise more as long as the
    noise stands in for them all.

    Args:
        fitter: fits hypotheses to the captures.
        best: the model without them.
        screened: candidates, the most promising first.
    """
    settings, fits, reached = fitter.settings, dict[str, Fit](), -math.inf
    first, others = screened[: settings.candidates_fitted], screened[settings.candidates_fitted :]
    for candidate in (*first, *(one for one in others if fitter.model.effects[one.name].is_discrete())):
        price = settings.min_gain_nats + 0.5 * len(candidate.start) * math.log(fitter.pixels)
        if candidate.gain > max(settings.min_gain_nats, settings.screened_share * price):
            start = candidate.added(fitter.model, best.hypothesis)
            fit = fitter.fit(start, 20, to_reach=reached - settings.abandon_nats, from_afar=True)
            if not fit.given_up:
                fits[candidate.name] = fit
                reached = max(reached, fit.fitted_log_likelihood)
    return fits
