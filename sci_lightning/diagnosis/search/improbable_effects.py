"""Improbable effects: names that the search added and that the captures do not support in the end.

Where the vocabulary lacks the true deviation, the search names the effects that come closest to it, and a free-form
deviation takes what they leave. Probabilities are those of the camera that has names only: what has no name is then
left in the residuals, clusters of pixels disagree about a name that merely stands in for it, and the name is worth
little (:mod:`~sci_lightning.diagnosis.search.probability`). Beside the free form it must be probable as well. The least
probable name is withdrawn first, because a stand-in beside it makes a right name look doubtful too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

from sci_lightning.diagnosis.fit.cluster_errors import cluster_errors
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.information_criterion import prune
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.search.probability import MIN_PROBABILITY, evidence_for
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed, quantified


def without_improbable_effects(
    fit: Fit,
    keep: Collection[str],
    unnamed: Sequence[Unnamed],
    on_progress: Callable[[str], None] = lambda message: None,
) -> tuple[Fit, list[Unnamed], dict[str, float]]:
    """Return the model without the names that are improbable, what has no name, quantified beside the others, and how
    probable the names were that are withdrawn.

    Args:
        fit: the model that the search selected.
        keep: effects that stay in any case: noise and errors of the laboratory.
        unnamed: the deviations of the model that have no name.
        on_progress: called with a one-line message for every name that is withdrawn.
    """
    stay = {*keep, *(deviation.name for deviation in unnamed)}
    rest, withdrawn = list(unnamed), dict[str, float]()
    while probabilities := name_probabilities(fit, stay, rest):
        name, least = min(probabilities.items(), key=lambda item: item[1])
        if least >= MIN_PROBABILITY:
            break
        on_progress(f"{name} is set aside: its probability is {least:.2g}")
        fit, withdrawn[name] = fit.without(name, iterations=20), least
        rest = [quantified(fit, one) for one in rest]
    if not withdrawn:
        return fit, rest, withdrawn
    fit = prune(fit, keep)
    return fit, [quantified(fit, one) for one in rest if one.name in fit.hypothesis.effects], withdrawn


def names_are_certain(fit: Fit, keep: Collection[str], unnamed: Sequence[Unnamed]) -> bool:
    """Return whether a model has names, and none of them is improbable; the arguments are as above."""
    probabilities = name_probabilities(fit, {*keep, *(deviation.name for deviation in unnamed)}, unnamed)
    return bool(probabilities) and min(probabilities.values()) >= MIN_PROBABILITY


def name_probabilities(fit: Fit, stay: Collection[str], unnamed: Sequence[Unnamed]) -> Mapping[str, float]:
    """Return how probable every name is: beside what has no name, or without that if it is less.

    Args:
        fit: the model.
        stay: effects that are not tested: noise, errors of the laboratory, and deviations without a name.
        unnamed: those deviations.
    """
    names = [name for name in fit.hypothesis.effects if name not in stay]
    probabilities = dict.fromkeys(names, 1.0)
    for model in [fit_names_only(fit, unnamed), fit] if names and unnamed else [fit] if names else []:
        errors = cluster_errors(model)
        for name in names:
            probabilities[name] = min(probabilities[name], evidence_for(model, name, errors).probability)
    return probabilities


def without_unnamed(hypothesis: Hypothesis, unnamed: Sequence[Unnamed]) -> Hypothesis:
    """Return a hypothesis without the deviations that have no name."""
    for deviation in unnamed:
        hypothesis = hypothesis.without(deviation.name)
    return hypothesis


def fit_names_only(fit: Fit, unnamed: Sequence[Unnamed]) -> Fit:
    """Fit the model without what has no name; the noise keeps its values, so that it does not absorb the misfit."""
    named = without_unnamed(fit.hypothesis, unnamed)
    effects = fit.fitter.model.effects
    fixed = tuple(
        (name, parameter) for name, setting in named.effects.items() if effects[name].noise for parameter in setting
    )
    return fit.fitter.fit(named, fixed=fixed)
