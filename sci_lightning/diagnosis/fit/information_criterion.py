"""Which of two models the captures prefer: the Bayesian information criterion, confirmed by held-out pixels."""

from __future__ import annotations

import math

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Hypothesis


def bic(fitter: Fitter, fit: Fit) -> float:
    """Return log-likelihood minus half of ln(n) for each parameter, in nats: -1/2 times Schwarz's criterion.

    n is the number of pixels. Larger is better.
    """
    return fit.log_likelihood - 0.5 * parameter_count(fit.hypothesis) * math.log(fitter.pixels)


def parameter_count(hypothesis: Hypothesis) -> int:
    """Return how many parameters a hypothesis has; a fixed-pattern map counts as the one that describes it."""
    return sum(len(setting) for setting in hypothesis.effects.values())


def bic_gain(fitter: Fitter, smaller: Fit, larger: Fit) -> float:
    """Return the nats by which a larger model is better than a smaller one, beyond ``SearchSettings.min_gain_nats``.

    It is minus infinity if the held-out pixels are not likelier with the larger model.
    """
    if fitter.split.held_out.any() and larger.held_out_log_likelihood <= smaller.held_out_log_likelihood:
        return -math.inf
    return bic(fitter, larger) - bic(fitter, smaller) - fitter.settings.min_gain_nats


def prune(fitter: Fitter, fit: Fit, keep: Hypothesis, margin: float = 0.0) -> Fit:
    """Eliminate backwards: drop every effect that is not worth its parameters beside the others.

    Args:
        fitter: fits hypotheses to the captures.
        fit: the model to be pruned.
        keep: effects that stay whatever they are worth.
        margin: nats beyond the parameters' penalty that an effect must be worth.
    """
    for name in [name for name in fit.hypothesis.effects if name not in keep.effects]:
        to_reach = fit.fitted_log_likelihood - margin - fitter.settings.abandon_nats
        without = fitter.fit(fit.hypothesis.without(name), to_reach=to_reach, from_afar=True)
        if not without.given_up and bic_gain(fitter, without, fit) <= margin:
            fit = without
    return fit


def judged_by(judge: Fitter, fit: Fit, maker: Fitter) -> Fit:
    """Return a fit as ``judge`` makes it, for which other pixels may count than for its maker."""
    return fit if judge.split.border == maker.split.border else judge.again(fit)


def compared_alike(fitter: Fitter, *fits: Fit) -> tuple[Fitter, list[Fit]]:
    """Return a fitter whose border suffices for several fits, and the fits with the pixels that count for it.

    Args:
        fitter: made all the fits.
        fits: to be compared.
    """
    wider = fitter.covering(*(fit.hypothesis for fit in fits))
    return wider, list(fits) if wider is fitter else [judged_by(wider, fit, fitter) for fit in fits]
