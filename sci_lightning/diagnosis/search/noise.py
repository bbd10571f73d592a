"""Which noise differs from the datasheet's.

More noise makes room for whatever a model of the camera gets wrong. The captures of even targets contain least of that,
and are what the noise of a sensor is measured on (EMVA standard 1288, release 4.0, section 6): they decide by
themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.model.hypothesis import ParameterName, datasheet_noise
from sci_lightning.diagnosis.search.probability import MIN_PROBABILITY, evidence_for

MAX_TIMES_DATASHEET = 8.0
"""Standard deviation of a sensor's noise, in that of its datasheet, beyond which it is not noise that is missing."""
LEAST_READ_NOISE = 0.5
"""Read noise in DN that a datasheet which states less is taken to mean."""


def select_noise(fit: Fit) -> tuple[Fit, Mapping[str, float]]:
    """Return the fit with the datasheet's noise where the captures bear it, and how probable the rest is, by name.

    Of the stated parameters, the one that gains most is freed if it probably differs
    (:mod:`~sci_lightning.diagnosis.search.probability`), in all captures and in those of even targets alone, and is not
    beyond what sensors are sold with. Then another one may follow.
    """
    datasheet, stated = datasheet_noise(fit.fitter.model.observation)

    def with_stated(fixed: Sequence[ParameterName]) -> Fit:
        start = fit.hypothesis
        for name, parameter in fixed:
            start = start.with_effect(name, {parameter: datasheet.effects[name][parameter]})
        return fit.fitter.fit(start, fixed=tuple(fixed), iterations=30)

    best, fixed, probable = with_stated(stated), [*stated], dict[str, float]()
    while fixed:
        freed = {one: with_stated([other for other in fixed if other != one]) for one in fixed}
        differs = {one: probability_of_noise(one, larger, best) for one, larger in freed.items()}
        differing = [one for one, probability in differs.items() if probability >= MIN_PROBABILITY]
        if not differing:
            break
        first = max(differing, key=lambda one: freed[one].log_likelihood)
        best, probable[first[0]] = freed[first], differs[first]
        fixed.remove(first)
    return best, probable


def beyond_datasheet(fit: Fit, *parameters: ParameterName) -> bool:
    """Return whether the noise of a fit is more than ``MAX_TIMES_DATASHEET`` times the datasheet's: it is not noise.

    Args:
        fit: whose noise it is.
        parameters: that are looked at; none for all that the datasheet states.
    """
    datasheet, stated = datasheet_noise(fit.fitter.model.observation)
    times = []
    for name, parameter in parameters or stated:
        value, nominal = (float(one.effects[name][parameter]) for one in (fit.hypothesis, datasheet))
        # a full well is an inverse variance
        is_well = fit.fitter.model.effects[name].about[parameter].log
        times.append(math.sqrt(nominal / max(value, 1e-9)) if is_well else value / max(nominal, LEAST_READ_NOISE))
    return max(times, default=0.0) > MAX_TIMES_DATASHEET


def probability_of_noise(one: ParameterName, freed: Fit, stated: Fit) -> float:
    """Return how probable it is that a parameter of the noise, freed in one fit, differs from that of another."""
    name, _ = one
    if beyond_datasheet(freed, one):
        return 0.0
    probability = evidence_for(freed, name, without=stated).probability
    observation = freed.fitter.model.observation
    even = torch.tensor([scene.shape[1:] == (1, 1) for scene in observation.scene])
    if probability < MIN_PROBABILITY or not even.any():
        return probability
    fitter = freed.fitter.of_captures(observation.take(even), fitted=True)
    others = tuple(other for other in FreeParameters.of(fitter.model, freed.hypothesis).names if other != one)
    alone, nominal = fitter.fit(freed.hypothesis, fixed=others), fitter.fit(stated.hypothesis, fixed=(*others, one))
    return min(probability, evidence_for(alone, name, without=nominal).probability)
