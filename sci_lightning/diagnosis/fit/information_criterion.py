"""Which of two models the captures prefer: the Bayesian information criterion."""

from __future__ import annotations

import math
from collections.abc import Collection

from sci_lightning.diagnosis.fit.fit import Fit

ABANDON_NATS = 60.0
"""Nats by which a fit may stay behind another one for good before it is abandoned; well above what the criterion's
penalty for parameters makes up for."""

CHANCE_NATS = 2.0
"""Nats by which other captures may be less likely by chance, where a map takes the place of one number, say."""


def bic(fit: Fit) -> float:
    """Return log-likelihood minus half of ln(n) for each parameter, in nats: -1/2 times Schwarz's criterion.

    n is the number of pixels that count. Larger is better; only fits with the same pixels can be compared. A
    fixed-pattern map counts as the one parameter that describes it.
    """
    parameters = sum(len(setting) for setting in fit.hypothesis.effects.values())
    return fit.log_likelihood - bic_penalty(parameters, fit.fitter.pixels)


def bic_penalty(parameters: int, pixels: float) -> float:
    """Return half of ln(n) for each parameter, n pixels, in nats."""
    return 0.5 * parameters * math.log(pixels)


def bic_gain(smaller: Fit, larger: Fit) -> float:
    """Return the nats by which a larger model is better than a smaller one, beyond ``SearchSettings.min_gain_nats``.

    In a laboratory it is minus infinity if the held-out captures are less likely with the larger model, by more than
    chance: where every capture has errors of its own, only other captures say whether they have something in common.
    """
    held_out = larger.held_out_log_likelihood - smaller.held_out_log_likelihood
    if larger.in_laboratory and larger.fitter.split.held_out.any() and held_out < -CHANCE_NATS:
        return -math.inf
    return bic(larger) - bic(smaller) - larger.fitter.settings.min_gain_nats


def prune(fit: Fit, keep: Collection[str], margin: float = 0.0) -> Fit:
    """Eliminate backwards: drop every effect that is not worth its parameters beside the others.

    Args:
        fit: the model to be pruned.
        keep: effects that stay whatever they are worth.
        margin: nats beyond the parameters' penalty that an effect must be worth.
    """
    fitter = fit.fitter
    for name in [name for name in fit.hypothesis.effects if name not in keep]:
        to_reach = fit.fitted_log_likelihood - margin - ABANDON_NATS
        without = fitter.fit(fit.hypothesis.without(name), to_reach=to_reach, from_afar=True)
        if not without.abandoned and bic_gain(without, fit) <= margin:
            fit = without
    return fit


def with_common_pixels(*fits: Fit) -> list[Fit]:
    """Return fits repeated with the pixels that do not depend on the unknown surround by any of them."""
    fitter = fits[0].fitter
    for fit in fits[1:]:
        fitter = fitter.with_border(fit.fitter.split.border)
    fitter = fitter.covering(*(fit.hypothesis for fit in fits))
    return [fitter.repeated(fit) for fit in fits]
