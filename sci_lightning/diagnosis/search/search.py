"""The search: which effects, and which deviations without a name, explain the captures best."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import bic, bic_gain, judged_by, prune
from sci_lightning.diagnosis.model.camera_model import Hypothesis, datasheet_noise
from sci_lightning.diagnosis.search.border_choice import (
    misfit_outside,
    with_all_predictable,
)
from sci_lightning.diagnosis.search.candidate_comparison import NEAR, compare_candidates
from sci_lightning.diagnosis.search.displacement import far_displacements
from sci_lightning.diagnosis.search.remaining_misfit import (
    Unnamed,
    best_free_form,
    explain_remaining_misfit,
    quantified,
    unnamed_threshold,
)
from sci_lightning.diagnosis.search.screening import rivals
from sci_lightning.diagnosis.search.spurious_effects import names_are_certain, without_doubtful_names

OnProgress = Callable[[str], None]
"""Called with a one-line message after every step of the search."""


@dataclass(frozen=True)
class Round:
    """One round of the forward selection.

    Attributes:
        screened: nats that every candidate was expected to gain, by name.
        fitted: nats that the fitted candidates gained in a joint fit, by name: on all pixels, and on held-out ones.
        added: the candidate that was added; None when none was worth its parameters.
        on_trial: whether it was added although held-out pixels did not confirm it, see :func:`select_effects`.
    """

    screened: dict[str, float]
    fitted: dict[str, tuple[float, float]]
    added: str | None
    on_trial: bool = False


@dataclass(frozen=True)
class Explanation:
    """What the search found.

    Attributes:
        fitter: leaves out what depends on the unknown surround in this model.
        fit: the likeliest model, with named effects and free-form deviations.
        names: the named effects, noise that differs from the datasheet's among them.
        rounds: of the forward selection that led there.
        unnamed: deviations that no effect of the vocabulary explains.
    """

    fitter: Fitter
    fit: Fit
    names: tuple[str, ...]
    rounds: tuple[Round, ...]
    unnamed: tuple[Unnamed, ...]


def search(fitter: Fitter, ideal: Fit, noise: Hypothesis, on_progress: OnProgress) -> Explanation:
    """Find the likeliest model of the camera.

    Named effects are selected first, then free-form deviations for what they leave. If something is left, or if many
    effects or another noise than the datasheet's were needed, named effects may only imitate something unnamed. Then
    the strongest free-form deviation is taken into the ideal model and the selection is repeated beside it: effects
    that imitated it are not needed any more. This second model counts if its information criterion is clearly better,
    and by more than the small errors of names that nothing makes doubtful.
    In the end every pixel counts that the model can predict, and names that may only stand in for what has none are
    withdrawn.

    Args:
        fitter: fits hypotheses to the captures.
        ideal: the fitted ideal camera with the datasheet's noise.
        noise: shot and read noise from which the search starts.
        on_progress: called with a one-line message after every step.
    """
    whole = fitter
    fitter, selected, rounds = select_effects(fitter, noise, on_progress)
    fitter, fit, unnamed = explain_remaining_misfit(fitter, selected, ideal, noise, (), on_progress)
    settled, differing = select_noise(fitter, fit, ideal)
    count = len(fit.hypothesis.effects) - len(noise.effects)
    if unnamed or differing or count >= fitter.settings.many_effects:
        start = fitter.fit(noise, iterations=30)
        least = unnamed_threshold(fitter, fit, start, noise=start)
        second, start, free_form, beside = best_free_form(fitter, start, least)
        first = judged_by(second, fit, fitter)
        if free_form is not None and bic(second, beside) > bic(second, start) + 0.5 * (
            first.log_likelihood - start.log_likelihood
        ):
            on_progress(f"beside it: {free_form.where}")
            second, other, other_rounds = select_effects(second, beside.hypothesis, on_progress)
            margin = second.settings.surrogate_fraction * (beside.log_likelihood - start.log_likelihood)
            other = prune(second, other, beside.hypothesis, margin)
            second, other, rest = explain_remaining_misfit(second, other, ideal, noise, (free_form,), on_progress)
            common = second.with_border(second.split.border | fitter.split.border)
            judged = [judged_by(common, made, by) for made, by in ((fit, fitter), (other, second))]
            # a free form that is as likely as a named effect (stray light as an offset, say) does not take its place,
            # nor one that is a little likelier than names which nothing makes doubtful: it follows small errors too
            gain = bic(common, judged[1]) - bic(common, judged[0])
            if gain > common.settings.indistinct_nats and (
                gain > margin or not names_are_certain(fitter, fit, noise, unnamed)
            ):
                fitter, fit, rounds, unnamed = second, other, other_rounds, rest
                settled, differing = select_noise(fitter, fit, ideal)
    fitter, completed, unnamed = complete(whole, fitter, fit, ideal, noise, unnamed, on_progress)
    if completed is not fit:
        settled, differing = select_noise(fitter, completed, ideal)
    free_forms = {deviation.name for deviation in unnamed}
    names = [name for name in completed.hypothesis.effects if name not in noise.effects and name not in free_forms]
    return Explanation(fitter, settled, tuple(names if unnamed else names + differing), tuple(rounds), tuple(unnamed))


def complete(
    whole: Fitter,
    fitter: Fitter,
    fit: Fit,
    ideal: Fit,
    noise: Hypothesis,
    unnamed: Sequence[Unnamed],
    on_progress: OnProgress,
) -> tuple[Fitter, Fit, list[Unnamed]]:
    """Take in every pixel that the selected model can predict, localise what only shows there, and doubt the names.

    Where a name is withdrawn, what has no name is localised anew.

    Args:
        whole: a fitter that leaves nothing out.
        fitter: that of the search, which left out what its candidates cannot predict.
        fit: the selected model.
        ideal: the fitted ideal camera.
        noise: effects that stay in any case.
        unnamed: deviations of the model without a name.
        on_progress: called with a one-line message after every step.

    Returns:
        the fitter, the model, and its deviations without a name; the same as before where nothing changes.
    """
    wide, fit = with_all_predictable(whole, fitter, fit)
    if wide is not fitter:
        unnamed = [quantified(wide, fit, one) for one in unnamed]
        if not unnamed and misfit_outside(wide, fit, fitter) > wide.settings.negligible_chi2:
            wide, fit, unnamed = explain_remaining_misfit(wide, fit, ideal, noise, (), on_progress)
    certain, left = without_doubtful_names(wide, fit, noise, unnamed, on_progress)
    if certain is fit or any(deviation.name in wide.model.vocabulary for deviation in left):
        return wide, certain, list(left)  # the map of a rejected effect is where nothing else would be localised
    named = certain.hypothesis  # what was localised beside names that are withdrawn may have another place without them
    for deviation in left:
        named = named.without(deviation.name)
    return explain_remaining_misfit(wide, wide.fit(named, iterations=20), ideal, noise, (), on_progress)


def select_effects(
    fitter: Fitter, start: Hypothesis, on_progress: OnProgress = lambda message: None
) -> tuple[Fitter, Fit, list[Round]]:
    """Select effects forward by the information criterion, confirmed by held-out pixels, and prune them backwards.

    Every round adds the effect whose joint fit gains most and refits everything. The noise is refitted every round too,
    so that it absorbs what is not explained yet and gives it back later. Where held-out pixels confirm no effect, one
    that gains much is added on trial: beside several deviations, a right name alone may predict other captures worse.
    It stays if another one follows, and the two together pass the test that it failed alone. Strong candidates leave
    out much at the sides of the field, because nobody knows what lies beyond it; where none of them gains much,
    weak ones are looked for, which need less room.

    Args:
        fitter: fits hypotheses to the captures.
        start: effects that stay in the model: the noise, and free-form deviations.
        on_progress: called with a one-line message for every effect that is added.

    Returns:
        the fitter whose border suffices for the model, the model fitted with it, and the rounds.
    """
    whole, fitter = fitter, fitter.covering(start)
    best = ideal = fitter.fit(start, iterations=30)
    rounds, settings = [], fitter.settings
    before_trial: tuple[Fitter, Fit] | None = None
    for _ in range(settings.max_effects):
        comparison = compare_candidates(fitter, best, far_displacements(fitter, best))
        least = settings.formula_error * comparison.fitter.explained_nats(comparison.best, ideal, comparison.best)
        added = comparison.winner(least)
        if comparison.gain_of(added) < settings.provisional_nats and comparison.leaves_out_much(whole):
            narrow = whole.covering(best.hypothesis)
            near = compare_candidates(narrow, judged_by(narrow, best, fitter), part=NEAR)
            weak = near.winner(least)
            # one that gains more there is a matter of some pixels at the sides, which are localised in the end
            if comparison.gain_of(added) < near.gain_of(weak) < settings.provisional_nats:
                comparison, added = near, weak
        fitter, best, fits = comparison.fitter, comparison.best, comparison.fits
        if on_trial := added is None and before_trial is None:
            added = comparison.refused(max(least, settings.provisional_nats))
        gains = comparison.gains()
        screened_gains = {candidate.name: candidate.gain for candidate in comparison.screened}
        rounds.append(Round(screened_gains, gains, added, on_trial and added is not None))
        if added is None:
            break
        on_progress(f"{added}: {gains[added][0]:.0f} nats{', on trial' if on_trial else ''}")
        needed = comparison.screener.covering(fits[added].hypothesis)
        larger = judged_by(needed, fits[added], fitter)
        if before_trial is not None:
            maker, untried = before_trial
            if bic_gain(needed, judged_by(needed, untried, maker), larger) <= least:
                break
        before_trial = (fitter, best) if on_trial else None
        fitter, best = needed, larger
        if not on_trial:
            best = prune(fitter, larger, start, settings.formula_error * fitter.explained_nats(larger, ideal, larger))
    fitter, best = exchange(*(before_trial or (fitter, best)), start)
    return fitter, best, rounds


def exchange(fitter: Fitter, fit: Fit, keep: Hypothesis) -> tuple[Fitter, Fit]:
    """Replace effects that were selected before the others were known, where another effect now fits better.

    Of two effects that the captures do not tell apart the plainer one stands.

    Args:
        fitter: fits hypotheses to the captures.
        fit: the selected model.
        keep: effects that stay.
    """
    waiting, asked = [name for name in fit.hypothesis.effects if name not in keep.effects], set[str]()
    while waiting:
        name = waiting.pop(0)
        asked.add(name)
        if name in fit.hypothesis.effects and len(fit.hypothesis.effects) - len(keep.effects) > 1:
            maker, without = fitter, fitter.fit(fit.hypothesis.without(name))
            effects, now = fitter.model.effects, name
            for other, rival in rivals(maker, fit, without, name):
                judge = fitter.covering(rival.hypothesis)
                former, instead = judged_by(judge, fit, fitter), judged_by(judge, rival, maker)
                needed = judge.settings.min_gain_nats
                if effects[now].plainer == other:
                    needed = -judge.settings.indistinct_nats
                elif effects[other].plainer == now:
                    needed = judge.settings.indistinct_nats
                if bic(judge, instead) > bic(judge, former) + needed:
                    fitter, fit, now = judge, instead, other
                    if needed < 0:  # the next rival would have to be better than what the plainer one replaced
                        break
            if now not in asked:  # what took its place may have other rivals
                waiting.append(now)
    return fitter, fit


def select_noise(fitter: Fitter, fit: Fit, ideal: Fit) -> tuple[Fit, list[str]]:
    """Return the fit with the datasheet's noise where the captures bear it, and the noise effects that differ from it.

    Every combination of stated parameters is fixed at the datasheet's values in turn; a freed one has to be worth its
    parameter, and what the formulas of strong effects get wrong, which would pass for noise.
    """
    datasheet, stated = datasheet_noise(fitter.model.observation)
    price = fitter.settings.min_gain_nats + 0.5 * math.log(fitter.pixels)
    price += fitter.settings.formula_error * fitter.explained_nats(fit, ideal, fit)
    best, differing, best_value = fit, [name for name, _ in stated], -math.inf
    for combination in range(2 ** len(stated)):
        fixed = tuple(parameter for i, parameter in enumerate(stated) if not combination >> i & 1)
        start = fit.hypothesis
        for name, parameter in fixed:
            start = start.with_effect(name, {parameter: datasheet.effects[name][parameter]})
        trial = fitter.fit(start, fixed=fixed, iterations=30)
        freed = [name for name, parameter in stated if (name, parameter) not in fixed]
        value = trial.log_likelihood - len(freed) * price
        if value > best_value:
            best, differing, best_value = trial, freed, value
    return best, differing
