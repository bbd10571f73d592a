"""The effects that were named: their parameters with errors, and what speaks for them.

The search decides which effects are in the model. Here every one is quantified for the report: how precisely its
parameters are known, how much log-likelihood the captures lose without it, and what else could explain as much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import torch

from sci_lightning.diagnosis.fit.cluster_errors import cluster_errors
from sci_lightning.diagnosis.fit.fit import MIN_LABORATORY_NATS, Fit
from sci_lightning.diagnosis.search.alternatives import alternatives
from sci_lightning.diagnosis.search.formula_error import FormulaError, formula_error
from sci_lightning.diagnosis.search.probability import evidence_for
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.effects.parameter import Parameter, Value


@dataclass(frozen=True)
class Estimate:
    """A parameter's value with its errors.

    Attributes:
        value: the maximum-likelihood estimate, or the choice.
        std: standard deviation by the disagreement of clusters of pixels and the error of the formula, in the
            parameter's unit; 0 for a choice.
        systematic: the error of the formula alone, see :mod:`~sci_lightning.diagnosis.search.formula_error`.
        unit: as in ``pixel``; ``1`` for a ratio.
    """

    value: Value
    std: float
    systematic: float
    unit: str

    @staticmethod
    def of(value: Value, about: Parameter, by_pixels: float, error: FormulaError) -> Estimate:
        """Return an estimate with the errors that pixels and the formula leave."""
        systematic = error.of(value, about)
        return Estimate(value, math.hypot(by_pixels, systematic), systematic, about.unit)


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the diagnosis names.

    Attributes:
        effect: its class, which has its name, its stage and the sentence that a report says about it.
        parameters: estimates by name.
        delta_nll: nats of log-likelihood that the captures lose without it; None for noise, which they always have.
        delta_bic: the difference of the Bayesian information criterion; None for noise.
        alternatives: names of the effects that explain the captures as well in its place.
        tell_apart: which captures would tell them apart, in full sentences; empty without alternatives.
        probability: that it is there, or one of its alternatives in its place; of noise, that it differs from the
            datasheet's. None where it was not computed.
        shares: of that probability, of the effect itself and of its alternatives, by name.
    """

    effect: type[Effect]
    parameters: Mapping[str, Estimate]
    delta_nll: float | None = None
    delta_bic: float | None = None
    alternatives: tuple[str, ...] = ()
    tell_apart: str = ""
    probability: float | None = field(default=None, kw_only=True)
    shares: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    def describe(self) -> dict[str, Any]:
        """Return the effect as it stands in ``report.json``."""
        evidence = {} if self.delta_nll is None else {"delta_nll": self.delta_nll, "delta_bic": self.delta_bic}
        return {
            "name": self.name,
            "stage": self.effect.stage,
            "parameters": {name: asdict(estimate) for name, estimate in self.parameters.items()},
            "evidence": evidence,
            "alternatives": list(self.alternatives),
            "tell_apart": self.tell_apart,
            **({} if self.probability is None else {"probability": self.probability, "class": dict(self.shares)}),
        }


@dataclass(frozen=True)
class ErrorCorrelation:
    """How the errors of the fitted parameters go together.

    Attributes:
        names: of the K parameters that the captures say something about; the effect's name alone where it has one.
        matrix: ``(K, K)`` correlation coefficients, -1 to 1.
    """

    names: tuple[str, ...]
    matrix: torch.Tensor


def named_effects(fit: Fit, names: Sequence[str], noise: Mapping[str, float]) -> tuple[NamedEffect, ...]:
    """Quantify every named effect: estimates with errors, and for all but noise the evidence from a fit without it.

    Args:
        fit: the model with all effects.
        names: the effects to be described, noise among them.
        noise: how probable that is, by effect.
    """
    fitter, errors = fit.fitter, cluster_errors(fit)
    effects = []
    for name in names:
        effect = fitter.model.effects[name]
        parameters = {}
        for parameter, about in effect.about.items():
            value = fit.hypothesis.effects[name][parameter]
            std = errors.deviation((name, parameter)) * (float(value) if about.log else 1.0)
            if name in fit.maps:
                std = fit.maps[name].std_error
            parameters[parameter] = Estimate.of(value, about, std, formula_error(fit))
        if effect.noise:
            effects.append(NamedEffect(effect, parameters, probability=noise[name], shares={name: 1.0}))
            continue
        without = fit.without(name, from_afar=True)
        evidence = evidence_for(fit, name, errors, without)
        other = alternatives(fit, without, name, evidence.dispersion)
        lost = fit.log_likelihood - without.log_likelihood
        delta_bic = 2 * lost - len(parameters) * float(np.log(fitter.pixels))
        effects.append(
            NamedEffect(
                effect,
                parameters,
                lost,
                delta_bic,
                other.names,
                other.tell_apart,
                probability=evidence.probability,
                shares=other.shares_beside(name),
            )
        )
    return tuple(effects)


def imperfections_in(fit: Fit) -> tuple[NamedEffect, ...]:
    """Return the errors of the laboratory, and what else is a matter of the captures, that a fit certainly has."""
    fitter, errors, certain = fit.fitter, cluster_errors(fit), list[NamedEffect]()
    for name, setting in fit.hypothesis.effects.items():
        effect = fitter.model.effects[name]
        if not effect.imperfection:
            continue
        ((parameter, size),) = setting.items()
        about = effect.about[parameter]
        if name in fit.maps:
            nats, error = fit.maps[name].evidence, fit.maps[name].std_error
        else:
            nothing = about.low if about.neutral is None else about.neutral
            without = fitter.model.predict(fit.hypothesis.with_effect(name, {parameter: nothing}))
            lost = (fitter.log_likelihood(fit.prediction) - fitter.log_likelihood(without)) * fitter.fitted
            error = errors.deviation((name, parameter)) * (float(size) if about.log else 1.0)
            nats = float(lost.sum(dtype=torch.float64))
        if nats > MIN_LABORATORY_NATS:
            certain.append(NamedEffect(effect, {parameter: Estimate(size, error, 0.0, about.unit)}))
    return tuple(certain)


def error_correlation(fit: Fit) -> ErrorCorrelation:
    """Return the correlation of the parameters' errors: the inverse information, normalised to a diagonal of 1."""
    informed = fit.information.diagonal() > 0
    free = [name for name, known in zip(fit.free, informed.tolist(), strict=True) if known]
    covariance = torch.linalg.pinv(fit.information[informed][:, informed], hermitian=True)
    deviation = covariance.diagonal().clamp(min=1e-300).sqrt()
    effects = [effect for effect, _ in free]
    names = [f"{effect} {parameter}" if effects.count(effect) > 1 else effect for effect, parameter in free]
    return ErrorCorrelation(tuple(names), (covariance / deviation[:, None] / deviation).clamp(-1, 1))
