"""Forward selection: the effects whose joint fits gain most, one by one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from sci_lightning.diagnosis.fit.budget import EXCHANGE_SHARE
from sci_lightning.diagnosis.fit.cluster_errors import cluster_errors
from sci_lightning.diagnosis.fit.fit import MIN_LABORATORY_NATS, Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import bic, prune, with_common_pixels
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.search.candidate_comparison import CandidateComparison, compare_candidates
from sci_lightning.diagnosis.search.displacement import far_displacements
from sci_lightning.diagnosis.search.noise import beyond_datasheet
from sci_lightning.diagnosis.search.probability import PRIOR_LOG_ODDS
from sci_lightning.diagnosis.search.remaining_misfit import FreeFormCandidate, best_free_form
from sci_lightning.diagnosis.search.screening import rivals

OnProgress = Callable[[str], None]
"""Called with a one-line message after every step of the search."""

LABORATORY_ITERATIONS = 6
"""Iterations of the fit that shows whether the laboratory has errors; it starts from a fitted model without them."""
MIN_PROBABLE_NATS = 10.0
"""Nats without which no effect can be more probable than not: the prior asks for four, its numbers for several more."""
IMPROBABLE_SHARE = 0.5
"""Part of the budget after which candidates that gain less are not fitted where the best ones are improbable: what has
no name needs the rest."""
MUCH_MORE = 10.0
"""Times the gain of the best probable candidate from which one that gains more has more to say."""
WEAK_NATS = 100.0
"""Gain below which effects are compared once more with narrow borders."""
WEAK_START_SHARE = 0.1
"""Part of a start's distance from doing nothing at which weak effects are looked for: their borders are a pixel or two
wide."""


@dataclass(frozen=True)
class Round:
    """One round of the forward selection.

    Attributes:
        screened: nats that every candidate was expected to gain, by name.
        fitted: nats that the fitted candidates gained in a joint fit, by name: on all pixels, and on held-out ones.
        added: the candidate that was added; None when none was worth its parameters.
        probabilities: of the candidates that were fitted, by name, where none was added.
    """

    screened: dict[str, float]
    fitted: dict[str, tuple[float, float]]
    added: str | None
    probabilities: Mapping[str, float] = field(default_factory=dict)


def select_effects(
    whole: Fitter, start: Hypothesis, on_progress: OnProgress = lambda message: None
) -> tuple[Fit, list[Round], list[FreeFormCandidate]]:
    """Select effects forward by the information criterion and by their probabilities, and prune them backwards.

    Every round adds the effect whose joint fit gains most, among those that are more probable than not, and refits
    everything. The noise is refitted every round too, so that it absorbs what is not explained yet and gives it back
    later. Strong candidates leave out much at the sides of the field, because nobody knows what lies beyond it; where
    none of them gains much, weak ones are looked for, which need narrower borders.

    All errors of a laboratory together are a candidate, too. Where they gain most they stay in every further model, and
    the effects that had to imitate them go. They are many numbers and take up a part of whatever is missing: where a
    deviation without a name gains more than they do, it comes before them.

    Args:
        whole: fits hypotheses to the captures.
        start: effects that stay in the model: the noise, and free-form deviations.
        on_progress: called with a one-line message for every effect that is added.

    Returns:
        the model, fitted on the pixels that it can predict, the rounds, and the deviation without a name that came
        before the errors of the laboratory, if any.
    """
    unnamed = list[FreeFormCandidate]()
    best = whole.covering(start).fit(start, iterations=30)
    rounds, settings, keep = list[Round](), whole.settings, {*start.effects, *whole.model.imperfections}
    for _ in range(settings.max_effects):
        if rounds and not whole.budget.allows("further effects"):
            break
        comparison = compare_candidates(best, far_displacements(best))
        gain = comparison.gain_of(comparison.winner())
        if gain < WEAK_NATS and comparison.leaves_out_much(whole):
            narrow = whole.covering(best.hypothesis)
            near = compare_candidates(narrow.repeated(best), part=WEAK_START_SHARE)
            # one that gains more there is a matter of some pixels at the sides, which are localised in the end
            if gain < near.gain_of(near.winner()) < WEAK_NATS:
                comparison = near
        comparison, added = most_probable(comparison)
        # errors of a laboratory are small: where much is missing, they would imitate effects
        in_order = added is None or not beyond_datasheet(comparison.best)
        if in_order and (in_laboratory := with_laboratory(comparison.best, comparison.gain_of(added))) is not None:
            if in_laboratory.beyond_laboratory and not unnamed:
                free_form, larger = larger_than_laboratory(comparison.best, in_laboratory, keep)
                if free_form is not None:
                    on_progress(f"more than errors of exposures and targets: {free_form.where}")
                    unnamed, keep = [free_form], {*keep, free_form.name}
                    best = prune(larger, keep)
                    continue
            on_progress("errors of exposures and targets become part of every model")
            best = prune(in_laboratory, keep)
            continue
        screened_gains = {candidate.name: candidate.gain for candidate in comparison.screened}
        probabilities = comparison.probabilities() if added is None else {}
        rounds.append(Round(screened_gains, comparison.gains(), added, probabilities))
        best = comparison.best
        if added is None:
            break
        on_progress(f"{added}: {comparison.gains()[added][0]:.0f} nats")
        larger = comparison.fits[added]
        best = with_plainer(prune(comparison.screener.covering(larger.hypothesis).repeated(larger), keep))
        if not {added, larger.fitter.model.effects[added].plainer} & {*best.hypothesis.effects}:
            # the same would be added again
            break
    return exchange(best, keep), rounds, unnamed


def most_probable(comparison: CandidateComparison) -> tuple[CandidateComparison, str | None]:
    """Return the best candidate that is more probable than not, and the comparison in which it is; None if none is.

    Where captures disagree, much likelihood may be gained by what is improbable, and candidates that gain less follow.
    In a laboratory all that promise anything follow: screening leaves the sizes of its errors as they are, which have
    grown by what an effect that they imitate would gain. A map that is not what its name says comes last: it holds what
    it imitates, for which there may be a name.

    While another strong effect is missing, captures disagree about a right one. What gains ``MUCH_MORE`` times as much
    as the best probable candidate therefore comes before it if it is more probable than before the captures were seen;
    how probable it is beside the others is asked again in the end.
    """
    refused, first, budget = set[str](), comparison, comparison.best.fitter.budget
    while (added := comparison.most_probable()) is None and budget.allows("improbable effects", IMPROBABLE_SHARE):
        largest = max((gain for gain, _ in comparison.gains().values()), default=0.0)
        refused.update(comparison.fits)  # what was abandoned for the sake of one of these has another chance
        if not comparison.fits or (largest < MIN_PROBABLE_NATS and not comparison.best.in_laboratory):
            break
        comparison = comparison.with_others(refused)
    if added is None and (imitating := first.most_probable(imitating=True)) is not None:
        return first, imitating
    supported = first.most_probable(least=PRIOR_LOG_ODDS)
    if first.gain_of(supported) > max(MUCH_MORE * comparison.gain_of(added), WEAK_NATS):
        return first, supported
    return comparison, added


def with_laboratory(fit: Fit, least: float) -> Fit | None:
    """Return a model with the errors of the laboratory, if it lacks them and they gain more than so many nats."""
    start = fit.fitter.model.with_imperfections(fit.hypothesis)
    if start is fit.hypothesis:
        return None
    larger = fit.fitter.fit(start, LABORATORY_ITERATIONS)
    gained = bic(larger) - bic(fit)
    return larger if gained > max(least, MIN_LABORATORY_NATS) else None


def larger_than_laboratory(fit: Fit, in_laboratory: Fit, keep: Collection[str]) -> tuple[FreeFormCandidate | None, Fit]:
    """Return a deviation without a name in the place of errors of the laboratory that are as large as they may be.

    It is probable, and gains at least half of what they do: they are hundreds of numbers, and take up much of whatever
    is missing. It may do so beside the names of the model, or in their place too: what a name imitates shows little
    beside it.

    Args:
        fit: the model without either.
        in_laboratory: the same with the errors of the laboratory.
        keep: effects that are no names.

    Returns:
        the deviation, and the model with it; None and the model as it was if there is none.
    """
    nothing = fit.hypothesis
    for name in [name for name in nothing.effects if name not in keep]:
        nothing = nothing.without(name)
    bare = fit if nothing is fit.hypothesis else fit.fitter.fit(nothing, iterations=30)
    best: tuple[FreeFormCandidate | None, Fit] = (None, fit)
    least = 0.5 * (bic(fit) + bic(in_laboratory))
    for start in (fit,) if bare is fit else (fit, bare):
        smaller, free_form, larger = best_free_form(start)
        if free_form is not None and bic(larger) > least + bic(smaller) - bic(start):
            best, least = (free_form, larger), bic(larger)
    return best


def exchange(fit: Fit, keep: Collection[str]) -> Fit:
    """Replace effects that were selected before the others were known, where another effect now fits better.

    Args:
        fit: the selected model.
        keep: effects that stay.
    """
    waiting, tried = [name for name in fit.hypothesis.effects if name not in keep], set[str]()
    while waiting:
        name = waiting.pop(0)
        tried.add(name)
        if name in fit.hypothesis.effects and len(fit.hypothesis.effects) - len(keep) > 1:
            if not fit.fitter.budget.allows(f"other effects in place of {name}", EXCHANGE_SHARE):
                continue
            effects, now = fit.fitter.model.effects, name
            for other, rival in rivals(fit, fit.without(name, from_afar=True), name):
                settings = fit.fitter.settings
                needed = settings.indistinct_nats if effects[other].plainer == now else settings.min_gain_nats
                former, instead = with_common_pixels(fit, rival)
                if bic(instead) > bic(former) + needed:
                    fit, now = instead, other
            if now not in tried:  # what took its place may have other rivals
                waiting.append(now)
    return with_plainer(fit)


def with_plainer(fit: Fit) -> Fit:
    """Replace effects by plainer ones that the captures do not tell from them.

    What tells them apart counts as much as clusters of pixels agree about the effect.
    """
    for name in fit.hypothesis.effects:
        other = fit.fitter.model.effects[name].plainer
        if other is not None and other not in fit.hypothesis.effects:
            indistinct = fit.fitter.settings.indistinct_nats * cluster_errors(fit).of_effect(name)[0]
            for _, rival in rivals(fit, fit.without(name, from_afar=True), name, only=(other,)):
                former, instead = with_common_pixels(fit, rival)
                fit = instead if bic(instead) > bic(former) - indistinct else fit
    return fit
