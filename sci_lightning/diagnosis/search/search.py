"""The search: which effects, and which deviations without a name, explain the captures best."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import bic, bic_gain, prune
from sci_lightning.diagnosis.model.camera_model import Hypothesis, datasheet_noise
from sci_lightning.diagnosis.search.remaining_misfit import (
    Unnamed,
    best_free_form,
    explain_remaining_misfit,
    unnamed_threshold,
)
from sci_lightning.diagnosis.search.screening import rivals, screen

OnProgress = Callable[[str], None]
"""Called with a one-line message after every step of the search."""


@dataclass(frozen=True)
class Round:
    """One round of the forward selection.

    Attributes:
        screened: nats that every candidate was expected to gain, by name.
        fitted: nats that the fitted candidates gained in a joint fit, by name: on all pixels, and on held-out ones.
        added: the candidate that was added; None when none was worth its parameters.
    """

    screened: dict[str, float]
    fitted: dict[str, tuple[float, float]]
    added: str | None


@dataclass(frozen=True)
class Explanation:
    """What the search found.

    Attributes:
        fit: the likeliest model, with named effects and free-form deviations.
        names: the named effects, noise that differs from the datasheet's among them.
        rounds: of the forward selection that led there.
        unnamed: deviations that no effect of the vocabulary explains.
    """

    fit: Fit
    names: tuple[str, ...]
    rounds: tuple[Round, ...]
    unnamed: tuple[Unnamed, ...]


def search(fitter: Fitter, ideal: Fit, noise: Hypothesis, on_progress: OnProgress) -> Explanation:
    """Find the likeliest model of the camera.

    Named effects are selected first, then free-form deviations for what they leave. If something is left, or if many
    effects or another noise than the datasheet's were needed, named effects may only imitate something unnamed. Then
    the strongest free-form deviation is taken into the ideal model and the selection is repeated beside it: effects
    that imitated it are not needed any more. The model with the better information criterion counts.

    Args:
        fitter: fits hypotheses to the captures.
        ideal: the fitted ideal camera with the datasheet's noise.
        noise: shot and read noise from which the search starts.
        on_progress: called with a one-line message after every step.
    """
    selected, rounds = select_effects(fitter, noise, on_progress)
    fit, unnamed = explain_remaining_misfit(fitter, selected, ideal, noise, (), on_progress)
    settled, differing = select_noise(fitter, fit)
    count = len(fit.hypothesis.effects) - len(noise.effects)
    if unnamed or differing or count >= fitter.settings.many_effects:
        start = fitter.fit(noise, iterations=30)
        free_form, beside = best_free_form(fitter, start, unnamed_threshold(fitter, fit, start, noise=start))
        if free_form is not None and bic(fitter, beside) > bic(fitter, start) + 0.5 * (
            fit.log_likelihood - start.log_likelihood
        ):
            on_progress(f"beside it: {free_form.where}")
            other, other_rounds = select_effects(fitter, beside.hypothesis, on_progress)
            margin = fitter.settings.surrogate_fraction * (beside.log_likelihood - start.log_likelihood)
            other = prune(fitter, other, beside.hypothesis, margin)
            other, rest = explain_remaining_misfit(fitter, other, ideal, noise, (free_form,), on_progress)
            if bic(fitter, other) > bic(fitter, fit):
                fit, rounds, unnamed = other, other_rounds, rest
                settled, differing = select_noise(fitter, fit)
    free_forms = {deviation.name for deviation in unnamed}
    names = [name for name in fit.hypothesis.effects if name not in noise.effects and name not in free_forms]
    return Explanation(settled, tuple(names if unnamed else names + differing), tuple(rounds), tuple(unnamed))


def select_effects(
    fitter: Fitter, start: Hypothesis, on_progress: OnProgress = lambda message: None
) -> tuple[Fit, list[Round]]:
    """Select effects forward by the information criterion, confirmed by held-out pixels, and prune them backwards.

    Every round adds the effect whose joint fit gains most and refits everything. The noise is refitted every round too,
    so that it absorbs what is not explained yet and gives it back later.

    Args:
        fitter: fits hypotheses to the captures.
        start: effects that stay in the model: the noise, and free-form deviations.
        on_progress: called with a one-line message for every effect that is added.
    """
    best = ideal = fitter.fit(start, iterations=30)
    rounds, settings = [], fitter.settings
    for _ in range(settings.max_effects):
        screened = screen(fitter, best)
        fits = {
            candidate.name: fitter.fit(candidate.added(fitter.model, best.hypothesis), iterations=20)
            for candidate in screened[: settings.candidates_fitted]
            if candidate.gain > settings.min_gain_nats
        }
        gains = {
            name: (
                fit.log_likelihood - best.log_likelihood,
                fit.held_out_log_likelihood - best.held_out_log_likelihood,
            )
            for name, fit in fits.items()
        }
        least = settings.formula_error * fitter.explained_nats(best, ideal, best)
        bic_gains = {name: bic_gain(fitter, best, fit) for name, fit in fits.items()}
        added = max((name for name in fits if bic_gains[name] > least), key=bic_gains.__getitem__, default=None)
        rounds.append(Round({candidate.name: candidate.gain for candidate in screened}, gains, added))
        if added is None:
            break
        on_progress(f"{added}: {gains[added][0]:.0f} nats")
        larger = fits[added]
        best = prune(fitter, larger, start, settings.formula_error * fitter.explained_nats(larger, ideal, larger))
    return exchange(fitter, best, start), rounds


def exchange(fitter: Fitter, fit: Fit, keep: Hypothesis) -> Fit:
    """Replace effects that were selected before the others were known, where another effect now fits better.

    Args:
        fitter: fits hypotheses to the captures.
        fit: the selected model.
        keep: effects that stay.
    """
    for name in [name for name in fit.hypothesis.effects if name not in keep.effects]:
        if name in fit.hypothesis.effects and len(fit.hypothesis.effects) - len(keep.effects) > 1:
            without = fitter.fit(fit.hypothesis.without(name))
            for _, rival in rivals(fitter, fit, without, name):
                if bic(fitter, rival) > bic(fitter, fit) + fitter.settings.min_gain_nats:
                    fit = rival
    return fit


def select_noise(fitter: Fitter, fit: Fit) -> tuple[Fit, list[str]]:
    """Return the fit with the datasheet's noise where the captures bear it, and the noise effects that differ from it.

    Every combination of stated parameters is fixed at the datasheet's values in turn; a freed one has to be worth its
    parameter.
    """
    datasheet, stated = datasheet_noise(fitter.model.observation)
    price = fitter.settings.min_gain_nats + 0.5 * math.log(fitter.fitted.numel())
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
