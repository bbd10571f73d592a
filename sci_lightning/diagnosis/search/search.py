"""The search: which effects, and which deviations without a name, explain the captures best."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from sci_lightning.diagnosis.fit.budget import Budget
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import residuals
from sci_lightning.diagnosis.fit.information_criterion import bic, prune
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.search.improbable_effects import (
    fit_names_only,
    names_are_certain,
    without_improbable_effects,
    without_unnamed,
)
from sci_lightning.diagnosis.search.noise import select_noise
from sci_lightning.diagnosis.search.remaining_misfit import (
    FIRST_FREE_FORM_SHARE,
    Unnamed,
    best_free_form,
    contradicted_maps,
    explain_remaining_misfit,
    likeliest_place,
    quantified,
)
from sci_lightning.diagnosis.search.selection import OnProgress, Round, select_effects
from sci_lightning.diagnosis.search_settings import SearchSettings


@dataclass(frozen=True)
class Explanation:
    """What a search over some captures found.

    Attributes:
        ideal: the ideal camera with the datasheet's noise, on the pixels that count for the fit.
        fit: the likeliest model, with named effects and free-form deviations; its fitter leaves out what depends on the
            unknown surround.
        names: the named effects.
        noise: how probably the noise differs from the datasheet's where it does, by effect.
        rounds: of the forward selection that led there.
        unnamed: deviations that no effect of the vocabulary explains.
        not_named: how probable the other effects are that were looked at last, and those that were withdrawn, by name.
    """

    ideal: Fit
    fit: Fit
    names: tuple[str, ...]
    noise: Mapping[str, float]
    rounds: tuple[Round, ...]
    unnamed: tuple[Unnamed, ...]
    not_named: Mapping[str, float]

    def corrected(self, free_forms: bool) -> Fit:
        """Return the corrected camera, with the deviations that have no name if ``free_forms``."""
        if free_forms or not self.unnamed:
            return self.fit
        return fit_names_only(self.fit, self.unnamed)


@dataclass(frozen=True)
class Selected:
    """A model that was selected in one of two ways: names first, or the strongest deviation without a name first."""

    fit: Fit
    unnamed: Sequence[Unnamed]
    rounds: Sequence[Round]


def ideal_camera(model: CameraModel, settings: SearchSettings, budget: Budget | None = None) -> Fit:
    """Divide the captures of a model into fitted and held-out pixels, and fit the ideal camera to them."""
    noise, stated = datasheet_noise(model.observation)
    fitter = Fitter(model, split(model.observation, settings), settings, budget=budget)
    return fitter.fit(noise, fixed=stated, iterations=30)


def explain(ideal: Fit, on_progress: OnProgress) -> Explanation:
    """Find the likeliest model of the camera.

    Named effects are selected first, then free-form deviations for what they leave. If something is left, if a name is
    improbable, or if another noise than the datasheet's was needed, named effects may only imitate something unnamed,
    and the search is repeated with the strongest free-form deviation first. In the end every pixel counts that the
    model can predict, and names that may only stand in for what has none are withdrawn.

    Args:
        ideal: the fitted ideal camera with the datasheet's noise, on all pixels.
        on_progress: called with a one-line message after every step.
    """
    whole = ideal.fitter
    noise, stated = datasheet_noise(whole.model.observation)
    keep = {*noise.effects, *whole.model.imperfections}
    fit, rounds, before = select_effects(whole, noise, on_progress)
    selected = Selected(*explain_remaining_misfit(fit, keep, before, on_progress), rounds)
    known, noise_names = select_noise(selected.fit)
    doubtful = selected.unnamed or noise_names or not names_are_certain(selected.fit, keep, ())
    if doubtful and whole.budget.allows("effects beside a deviation without a name"):
        other = _with_a_free_form_first(selected, keep, on_progress)
        if other is not None:
            selected, (known, noise_names) = other, select_noise(other.fit)
    settled, left, withdrawn = complete(whole, known, keep, selected.unnamed, on_progress)
    if settled is not known:
        settled, noise_names = select_noise(settled)
    free_forms = {deviation.name for deviation in left}
    names = [
        name
        for name in settled.hypothesis.effects
        if name not in keep and name not in free_forms and not whole.model.effects[name].imperfection
    ]
    ideal = settled.fitter.fit(noise, fixed=stated, iterations=30)
    looked_at = {**(selected.rounds[-1].probabilities if selected.rounds else {}), **withdrawn}
    not_named = {name: one for name, one in looked_at.items() if name not in settled.hypothesis.effects}
    explanation = Explanation(ideal, settled, tuple(names), noise_names, tuple(selected.rounds), tuple(left), not_named)
    return _without_contradicted_maps(explanation, on_progress)


def _with_a_free_form_first(first: Selected, keep: Collection[str], on_progress: OnProgress) -> Selected | None:
    """Select effects beside the strongest free-form deviation; return the model if it is better, else None.

    Effects that imitated the deviation are not needed beside it. The model counts if its information criterion is
    clearly better, and a name of the other one is improbable: a free form follows the small errors of right names too.

    Args:
        first: the model whose names were selected without it.
        keep: effects that stay in any case, from which the search starts.
        on_progress: called with a one-line message after every step.
    """
    nothing = first.fit.hypothesis
    for name in [name for name in nothing.effects if name not in keep]:
        nothing = nothing.without(name)
    start = first.fit.fitter.fit(nothing, iterations=30)
    start, free_form, larger = best_free_form(start)
    if free_form is None:
        return None
    gained_by_names = start.fitter.repeated(first.fit).log_likelihood - start.log_likelihood
    if bic(larger) <= bic(start) + 0.5 * gained_by_names:
        return None
    on_progress(f"beside it: {free_form.where}")
    fit, rounds, _ = select_effects(start.fitter, larger.hypothesis, on_progress)
    fit = prune(fit, larger.hypothesis.effects)
    fit, unnamed = explain_remaining_misfit(fit, keep, (free_form,), on_progress)
    common = fit.fitter.with_border(first.fit.fitter.split.border)
    # a free form that is as likely as a named effect (stray light as an offset, say) does not take its place
    gain = bic(common.repeated(fit)) - bic(common.repeated(first.fit))
    better = gain > common.settings.indistinct_nats and not names_are_certain(first.fit, keep, first.unnamed)
    return Selected(fit, unnamed, rounds) if better else None


def complete(
    whole: Fitter, fit: Fit, keep: Collection[str], unnamed: Sequence[Unnamed], on_progress: OnProgress
) -> tuple[Fit, Sequence[Unnamed], Mapping[str, float]]:
    """Take in every pixel that the selected model can predict, localise what only shows there, and drop spurious names.

    Where a name is withdrawn, what has no name is localised anew.

    Args:
        whole: a fitter that leaves nothing out.
        fit: the selected model; the search had left out more for the sake of its candidates.
        keep: effects that stay in any case.
        unnamed: deviations of the model without a name.
        on_progress: called with a one-line message after every step.

    Returns:
        the model and its deviations without a name, the same as before where nothing changes, and how probable the
        names were that are withdrawn.
    """
    wide = with_all_predictable(whole, fit)
    if wide is not fit:
        unnamed = [quantified(wide, one) for one in unnamed]
        if not unnamed and misfit_outside(wide, fit.fitter) > whole.settings.negligible_chi2:
            wide, unnamed = explain_remaining_misfit(wide, keep, (), on_progress)
    certain, left, withdrawn = without_improbable_effects(wide, keep, unnamed, on_progress)
    if certain is wide or any(deviation.name in whole.model.vocabulary for deviation in left):
        return certain, left, withdrawn  # the map of a rejected effect is where nothing else would be localised
    if left and not whole.budget.allows("another place of what has no name", share=FIRST_FREE_FORM_SHARE):
        return certain, left, withdrawn
    # what was localised beside names that are withdrawn may have another place without them
    named = without_unnamed(certain.hypothesis, left)
    return *explain_remaining_misfit(certain.fitter.fit(named, iterations=20), keep, (), on_progress), withdrawn


def with_all_predictable(whole: Fitter, fit: Fit) -> Fit:
    """Return a model fitted with every pixel that it can predict; itself where no more pixels count then."""
    wide = whole.covering(fit.hypothesis)
    return wide.repeated(fit) if wide.pixels > fit.fitter.pixels else fit


def misfit_outside(fit: Fit, narrow: Fitter) -> float:
    """Return reduced chi2, of randomised quantile residuals, of pixels that count for a fit and not for a fitter."""
    wide = fit.fitter
    residual = residuals(wide, fit.uncertain_prediction, seed=0)
    outside = torch.ones(wide.model.observation.size, dtype=torch.bool)
    outside[narrow.split.window] = False
    return float(residual[:, outside[wide.split.window]].square().mean())


def with_likeliest_place(explanation: Explanation, on_progress: OnProgress) -> Explanation:
    """Say where a model misses something that it has no name for, and withdraw the names that are improbable beside it.

    Args:
        explanation: without anything unnamed.
        on_progress: called with a one-line message after every step.
    """
    fit, unnamed = likeliest_place(explanation.fit)
    if not unnamed:
        return explanation
    on_progress(f"unnamed, perhaps: {unnamed[0].where}")
    keep = {name for name in fit.hypothesis.effects if name not in explanation.names and name != unnamed[0].name}
    fit, unnamed, withdrawn = without_improbable_effects(fit, keep, unnamed, on_progress)
    names = tuple(name for name in explanation.names if name in fit.hypothesis.effects)
    return replace(
        explanation,
        ideal=fit.fitter.repeated(explanation.ideal),
        fit=fit,
        names=names,
        unnamed=tuple(unnamed),
        not_named={**explanation.not_named, **withdrawn},
    )


def _without_contradicted_maps(explanation: Explanation, on_progress: OnProgress) -> Explanation:
    """Take the names of maps back that are not what their effects are once deviations without a name are left out.

    Beside such a deviation, which takes what does not fit, any map looks right.
    """
    contradicted = contradicted_maps(explanation.corrected(free_forms=False)) if explanation.unnamed else {}
    for name in explanation.names:
        if name in contradicted:
            on_progress(f"{name} is set aside: its map is not what its name says")
            names = tuple(other for other in explanation.names if other != name)
            explanation = replace(explanation, fit=explanation.fit.without(name, iterations=20), names=names)
    return explanation
