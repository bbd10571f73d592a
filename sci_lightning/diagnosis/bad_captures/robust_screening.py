r"""A first look for bad captures, before the search: which capture does no combination of effects explain?

The deviation of the captures from the ideal camera is regressed on what every effect of the vocabulary would change,
all at once, where every capture n has an unknown variance of its own: the sum over the captures of
:math:`\tfrac{P}{2}\,\log\,\overline{(r_n - D_n a)^2}` is minimised, with r the deviation in standard deviations, D the
changes, a their factors and P the pixels. One capture that contradicts the others then costs little, whatever it says
(Huber and Ronchetti, "Robust Statistics", 2009, chapter 7: reweighted least squares). The search begins without a
capture that stays far away while the others come near; whether it is really bad is decided after the search.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch

from sci_lightning.diagnosis.bad_captures.judgement import most_bad
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.search.border_choice import border_for_starts

PIXELS = 768
"""Pixels of a capture that are looked at."""
FAR = 8.0
"""Times as far from the model as any other capture is, from which a capture is left out at first."""
ALARM = 3.0
"""Least ratio of the largest misfit to the median one by the ideal camera: below it, nothing is looked at closely."""
LEAST_CAPTURES = 8
"""Captures without which nobody can say which one is odd."""
RIDGE = 0.1
"""Weight of a factor's square: factors of some ten are possible, but have to be worth it."""
ITERATIONS = 40
SEED = 0
"""Seed of the choice of pixels."""


def suspects(fitter: Fitter, ideal: Fit) -> torch.Tensor:
    """Return ``(N,)`` bool: captures that no combination of effects explains together with the others.

    Args:
        fitter: holds captures and model.
        ideal: the ideal camera, fitted.
    """
    observation = fitter.model.observation
    count, most = len(observation), most_bad(len(observation))
    nobody = torch.zeros(count, dtype=torch.bool)
    if count < LEAST_CAPTURES:
        return nobody
    fitter = border_for_starts(fitter, ideal.hypothesis)
    counted, prediction = fitter.dn[0].numel(), fitter.predicted(ideal)
    inside = torch.randperm(counted, generator=torch.Generator().manual_seed(SEED))[:PIXELS]
    deviation = (prediction.deviation.square() + 1 / 12).sqrt().flatten(1)[:, inside]
    full_scale = observation.full_scale
    mean, dn = (field.flatten(1)[:, inside] for field in (prediction.mean, fitter.dn))
    residual = (dn - mean.clamp(0, full_scale)) / deviation
    misfit = residual.square().mean(1).double()
    if float(misfit.max()) < ALARM * max(1.0, float(misfit.median())):
        return nobody
    changes = torch.stack(
        [
            (change.flatten(1)[:, inside].clamp(0, full_scale) - mean.clamp(0, full_scale)) / deviation
            for change in _changes(fitter, ideal)
        ],
        -1,
    )
    misfit = _robust_misfit(changes.double(), residual.double())
    order = misfit.argsort(descending=True)
    gaps = [float(misfit[order[k - 1]] / misfit[order[k]].clamp(min=1.0)) for k in range(1, min(most, count - 1) + 1)]
    if max(gaps) < FAR:
        return nobody
    nobody[order[: 1 + max(range(len(gaps)), key=gaps.__getitem__)]] = True
    return nobody


def _changes(fitter: Fitter, ideal: Fit) -> Iterator[torch.Tensor]:
    """Yield the predicted captures ``(N, H, W)`` with every effect of the vocabulary, at every one of its starts."""
    model = fitter.model
    for name, effect in model.vocabulary.items():
        if effect.noise or effect.map_kind or name in ideal.hypothesis.effects:
            continue
        for start in model.starts(name, ideal.hypothesis):
            trial = model.predict(model.adding(ideal.hypothesis, name, start))
            if trial.bits == ideal.prediction.bits:
                yield trial.mean


def _robust_misfit(changes: torch.Tensor, residual: torch.Tensor) -> torch.Tensor:
    """Return the mean square ``(N,)`` that the best combination of changes leaves of every capture.

    Args:
        changes: ``(N, P, K)`` in standard deviations.
        residual: ``(N, P)`` likewise.
    """
    pixels = residual.shape[1]
    products = torch.einsum("npk,npl->nkl", changes, changes)
    along = torch.einsum("npk,np->nk", changes, residual)
    squares = residual.square().sum(1)
    misfit = squares / pixels
    ridge = RIDGE * torch.eye(changes.shape[-1], dtype=changes.dtype)
    for _ in range(ITERATIONS):
        weight = 1 / misfit.clamp(min=1.0)
        information = torch.einsum("n,nkl->kl", weight, products) + ridge
        factors = torch.linalg.solve(information, weight @ along)
        left = squares - 2 * along @ factors + torch.einsum("k,nkl,l->n", factors, products, factors)
        before, misfit = misfit, left.clamp(min=0) / pixels
        if float((misfit.clamp(min=1.0) / before.clamp(min=1.0)).log().abs().max()) < 1e-3:
            break
    return misfit
