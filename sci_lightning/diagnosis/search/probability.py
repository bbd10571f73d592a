"""How probable it is that an effect is there, given the captures.

Models with the effect, without it, and with another effect in its place are compared by their evidence: the likelihood
averaged over the prior of the parameters, by Laplace's approximation (MacKay, "Information Theory, Inference, and
Learning Algorithms", 2003, chapter 28). What the effect gains is measured by how far clusters of pixels disagree
(:mod:`~sci_lightning.diagnosis.fit.cluster_errors`): a model that is a little wrong everywhere leaves more than noise,
and nats of pixels that are not independent are too many. As the disagreement itself is estimated, from few clusters,
the likelihood is that of Student's t.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.cluster_errors import ClusterErrors, cluster_errors
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap, hot_penalty, likeliest_prior
from sci_lightning.diagnosis.model.map_system import DENSE
from sci_lightning.diagnosis.search.formula_error import formula_error
from sci_lightning.encoder.effects.parameter import part_of

PRIOR_PROBABILITY = 0.02
"""Prior probability that an effect is there: of some thirty effects a camera has less than one."""
PRIOR_LOG_ODDS = math.log(PRIOR_PROBABILITY / (1 - PRIOR_PROBABILITY))
MIN_PROBABILITY = 0.5
"""Probability below which a name is withdrawn: it is wrong more often than right."""
PRIOR_STEPS = 100.0
"""Width of a parameter's prior in steps of the parameter, where its bounds are not narrower."""
NEARLY_NEUTRAL_SHARE = 1e-3
"""Part of the distance from their neutral values that the parameters of an effect keep which does nearly nothing."""


@dataclass(frozen=True)
class Evidence:
    """What the captures say for an effect, against the same model without it.

    Attributes:
        nats: log-likelihood that is lost without it, after everything else has been fitted again.
        dispersion: factor by which variances are larger than if the model were right.
        log_bayes_factor: natural logarithm of the ratio of the evidences.
    """

    nats: float
    dispersion: float
    log_bayes_factor: float

    @property
    def log_odds(self) -> float:
        """Natural logarithm of the odds that the effect is there, if no other effect could be in its place."""
        return self.log_bayes_factor + PRIOR_LOG_ODDS

    @property
    def probability(self) -> float:
        """Probability that the effect is there, if no other could be in its place."""
        return probability_of(self.log_odds)


def probability_of(log_odds: float) -> float:
    """Return the probability that has such odds."""
    return 1 / (1 + math.exp(-max(min(log_odds, 700.0), -700.0)))


def evidence_for(fit: Fit, name: str, errors: ClusterErrors | None = None, without: Fit | None = None) -> Evidence:
    """Return what the captures say for an effect of a fit.

    Args:
        fit: the model.
        name: of an effect in it.
        errors: of its parameters; None to compute them.
        without: the best fit without the effect; None to make it.
    """
    errors = errors or cluster_errors(fit)
    without = without or fit.without(name, from_afar=True)
    nats = min(fit.log_likelihood - without.log_likelihood, nats_from_nothing(fit, name))
    dispersion, freedom = errors.of_effect(name)
    of_maps = prior_nats(fit, without)
    numbers = max(1, sum(effect == name for effect, _ in errors.names))
    gain = calibrated(nats - of_maps, dispersion, freedom, numbers) + of_maps
    if name in fit.maps:
        gain = min(gain, map_evidence(fit, fit.maps[name], dispersion))
    gain = min(gain, nats_beyond_errors(fit, name, errors))
    return Evidence(nats, dispersion, gain - occam_factor(fit, name, errors))


def prior_nats(fit: Fit, without: Fit) -> float:
    """Return the nats by which the camera's own maps are likelier, at most what is gained at all.

    They are no matter of pixels, which may disagree: without a black level, say, the offsets of columns hold it, and
    have to be larger.
    """
    gained = sum(
        without.maps[name].penalty - one.penalty
        for name, one in fit.maps.items()
        if name in without.maps and not one.of_captures
    )
    return min(max(gained, 0.0), max(fit.log_likelihood - without.log_likelihood, 0.0))


def map_evidence(fit: Fit, one: FixedPatternMap, dispersion: float) -> float:
    """Return the nats that a map gains where variances are so much larger than noise makes them.

    A map follows what it is fitted to, so that its nats divided by the dispersion would be too many. What other maps
    could say as well, such as errors of the targets, is not counted.
    """
    from_zero, information = (
        one.likelihood_gradient + one.likelihood_information * one.values,
        one.likelihood_information,
    )
    if one.kind == "hot":
        gains = 0.5 * from_zero.square() / information.clamp(min=1e-9) / dispersion
        return float((gains - hot_penalty(one.values))[one.values > 0].sum())
    if one.kind in DENSE:
        precision = fit.derivatives.system.own_precision(one)
        information, turn = torch.linalg.eigh(precision - torch.eye(len(precision)) / max(one.std, 1e-9) ** 2)
        from_zero, information = turn.T @ (precision @ one.values.flatten()), information.clamp(min=0)
    return likeliest_prior(from_zero / dispersion, information / dispersion)[1]


def nats_from_nothing(fit: Fit, name: str) -> float:
    """Return the nats by which the numbers of an effect are likelier than nearly neutral ones, all else unchanged.

    The effect itself stays, so that the form of its noise does not count: that of a saturation at full scale, say, may
    take up pixels that nothing explains. Infinite for maps and for effects without neutral numbers.
    """
    fitter = fit.fitter
    about, setting = fitter.model.effects[name].about, fit.hypothesis.effects[name]
    if name in fit.maps or not any(isinstance(one.neutral, (int, float)) for one in about.values() if not one.choices):
        return math.inf
    nothing = fitter.model.predict(fit.hypothesis.with_effect(name, part_of(setting, about, NEARLY_NEUTRAL_SHARE)))
    loss = (fitter.log_likelihood(fit.prediction) - fitter.log_likelihood(nothing)) * fitter.fitted
    return float(loss.sum(dtype=torch.float64))


def nats_beyond_errors(fit: Fit, name: str, errors: ClusterErrors) -> float:
    """Return the nats by which the numbers of an effect are larger than their errors, their formula's among them.

    Pixels can say no more for it: where a likelihood ratio is larger, what gains is not the effect but what is fitted
    beside it, such as the sizes of errors of the laboratory. Infinite for choices, maps, noise, and numbers that have
    no neutral value or one that stands for infinity.
    """
    effect, setting, error = fit.fitter.model.effects[name], fit.hypothesis.effects[name], formula_error(fit)
    numbers = [one for one, about in effect.about.items() if (name, one) in errors.names and error.of_nothing(about)]
    if effect.noise or name in fit.maps or not numbers:
        return math.inf
    places = [errors.names.index((name, one)) for one in numbers]
    scale = errors.dispersions[places].sqrt()
    formula = torch.tensor([error.of_nothing(effect.about[one]) ** 2 for one in numbers], dtype=torch.float64)
    covariance = errors.model[places][:, places] * scale[:, None] * scale + formula.diag()
    away = torch.tensor([float(setting[one]) - float(effect.about[one].neutral or 0.0) for one in numbers]).double()
    squares = float(away @ torch.linalg.solve(covariance, away))
    return calibrated(squares / 2, 1.0, float(errors.freedom[places].min()), len(places))


def calibrated(nats: float, dispersion: float, freedom: float, numbers: int = 1) -> float:
    """Return the logarithm of a likelihood ratio by Student's t of so many numbers, from one of independent Gaussians.

    Args:
        nats: of independent pixels.
        dispersion: factor by which variances are larger than that.
        freedom: degrees of freedom of the dispersion.
        numbers: that the likelihood is a function of.
    """
    if nats <= 0 or math.isinf(freedom):
        return nats / dispersion
    return 0.5 * (freedom + numbers) * math.log1p(2 * nats / (dispersion * freedom))


def occam_factor(fit: Fit, name: str, errors: ClusterErrors) -> float:
    """Return what the evidence loses because the parameters of an effect might have been anything, in nats.

    For a number it is the logarithm of the width of its prior over that of its likelihood, for a choice the logarithm
    of the number of choices.
    """
    lost, error = 0.0, formula_error(fit)
    for parameter, about in fit.fitter.model.effects[name].about.items():
        if about.choices:
            lost += math.log(len(about.choices))
            continue
        width = about.high - about.low
        deviation = errors.deviation((name, parameter))
        if name in fit.maps:
            deviation = fit.maps[name].std_error
        width = math.log(about.high / max(about.low, 1e-300)) if about.log else min(width, PRIOR_STEPS * about.step)
        if deviation > 0:
            deviation = math.hypot(deviation, error.of_nothing(about))
            lost += max(0.0, math.log(width / (math.sqrt(2 * math.pi) * deviation)))
    return lost
