r"""Which captures do not fit the others: a first look before the search, and a decision after it.

The deviation of the captures from the ideal camera is regressed on what every effect of the vocabulary would change,
all at once, where every capture n has an unknown variance of its own: the sum over the captures of
:math:`\tfrac{P}{2}\,\log\,\overline{(r_n - D_n a)^2}` is minimised, with r the deviation in standard deviations, D the
changes, a their factors and P the pixels. One capture that contradicts the others then costs little, whatever it says
(Huber and Ronchetti, "Robust Statistics", 2009, chapter 7: reweighted least squares). The search begins without a
capture that stays far away while the others come near; whether it is really bad is decided after the search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import CLIP_SIGMAS, residuals, transferred
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.model.starting_points import starting_settings, with_effect_at
from sci_lightning.diagnosis.search.candidate_comparison import covering_starts

SCREENED_PIXELS = 768
"""Pixels of a capture that are looked at."""
MIN_RATIO_TO_NEXT_MISFIT = 8.0
"""Times as far from the model as any other capture is, from which a capture is left out at first."""
MIN_RATIO_TO_MEDIAN_MISFIT = 3.0
"""Least ratio of the largest misfit to the median one by the ideal camera: below it, nothing is looked at closely."""
MIN_CAPTURES = 8
"""Captures without which nobody can say which one is odd."""
FACTOR_RIDGE = 0.1
"""Weight of a factor's square: factors of some ten are possible, but have to be worth it."""
MAX_REWEIGHTINGS = 40
PIXEL_SEED = 0
"""Seed of the choice of pixels."""
MIN_EXCESS_CHI2 = 0.5
"""Excess of chi2 over 1 from which a capture may be called bad."""
MIN_EXCESS_RATIO = 5.0
"""How many times the largest excess of the other captures it must have as well: formulas are a little inexact."""
MAX_OTHERS_CHI2 = 3.0
"""Largest chi2 of the other captures. If they do not fit either, an effect is missing, and no capture is bad."""
MIN_CAPTURES_OF_KIND = 2
"""Captures of the same kind that must fit: the only one of its kind may show what no other capture can show."""
MIN_SUSPICIOUS_RATIO = 3.0
"""How many times as large as the median of all and as the next one a misfit is that a search is repeated without."""


def suspects(ideal: Fit) -> torch.Tensor:
    """Return ``(N,)`` bool: captures that no combination of effects explains together with the others.

    Args:
        ideal: the ideal camera, fitted.
    """
    observation = ideal.fitter.model.observation
    count, most = len(observation), most_bad(len(observation))
    nobody = torch.zeros(count, dtype=torch.bool)
    if count < MIN_CAPTURES:
        return nobody
    fitter = covering_starts(ideal.fitter, ideal.hypothesis)
    counted, prediction = fitter.dn[0].numel(), fitter.predicted(ideal)
    inside = torch.randperm(counted, generator=torch.Generator().manual_seed(PIXEL_SEED))[:SCREENED_PIXELS]
    deviation = (prediction.deviation.square() + 1 / 12).sqrt().flatten(1)[:, inside]
    full_scale = observation.full_scale
    mean, dn = (field.flatten(1)[:, inside] for field in (prediction.mean, fitter.dn))
    residual = (dn - mean.clamp(0, full_scale)) / deviation
    misfit = residual.square().mean(1).double()
    if float(misfit.max()) < MIN_RATIO_TO_MEDIAN_MISFIT * max(1.0, float(misfit.median())):
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
    if max(gaps) < MIN_RATIO_TO_NEXT_MISFIT:
        return nobody
    nobody[order[: 1 + max(range(len(gaps)), key=gaps.__getitem__)]] = True
    return nobody


def _changes(fitter: Fitter, ideal: Fit) -> Iterator[torch.Tensor]:
    """Yield the predicted captures ``(N, H, W)`` with every effect of the vocabulary, at every one of its starts."""
    model = fitter.model
    for name, effect in model.vocabulary.items():
        if effect.noise or effect.map_kind or name in ideal.hypothesis.effects:
            continue
        for start in starting_settings(model, name, ideal.hypothesis):
            predicted = model.predict(with_effect_at(model, ideal.hypothesis, name, start))
            if predicted.bits == ideal.prediction.bits:
                yield predicted.mean


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
    ridge = FACTOR_RIDGE * torch.eye(changes.shape[-1], dtype=changes.dtype)
    for _ in range(MAX_REWEIGHTINGS):
        weight = 1 / misfit.clamp(min=1.0)
        information = torch.einsum("n,nkl->kl", weight, products) + ridge
        factors = torch.linalg.solve(information, weight @ along)
        left = squares - 2 * along @ factors + torch.einsum("k,nkl,l->n", factors, products, factors)
        before, misfit = misfit, left.clamp(min=0) / pixels
        if float((misfit.clamp(min=1.0) / before.clamp(min=1.0)).log().abs().max()) < 1e-3:
            break
    return misfit


def misfit_by_capture(fit: Fit, observation: Observation, seed: int = 0) -> torch.Tensor:
    """Return the mean square of the clipped residuals of every capture, ``(N,)`` float64; about 1 for a right fit.

    Args:
        fit: the model, whose fitter knows which pixels count.
        observation: captures of the same camera, whether the fit has seen them or not.
        seed: of the residuals' randomisation.
    """
    fitter = fit.fitter.of_captures(observation, fitted=True)
    residual = residuals(fitter, transferred(fit, fitter).uncertain_prediction, seed)
    return residual.clamp(-CLIP_SIGMAS, CLIP_SIGMAS).square().mean((1, 2), dtype=torch.float64)


def most_bad(captures: int) -> int:
    """Return how many of so many captures may be called bad; if more do not fit, it is no matter of single captures."""
    return max(1, captures // 10)


def outlying(misfit: torch.Tensor, kinds: Sequence[str], most: int) -> torch.Tensor:
    """Return ``(N,)`` bool: captures that certainly do not fit while all others do.

    Args:
        misfit: ``(N,)``, see :func:`misfit_by_capture`, by a model that was fitted without these captures.
        kinds: of the N captures.
        most: how many captures may be called bad.
    """
    order = misfit.argsort(descending=True)
    bad = torch.zeros(len(misfit), dtype=torch.bool)
    for count in range(min(most, len(misfit) - 1), 0, -1):
        least, worst = float(misfit[order[count - 1]]), max(1.0, float(misfit[order[count]]))
        if worst <= MAX_OTHERS_CHI2 and least - 1 >= MIN_EXCESS_RATIO * (worst - 1) + MIN_EXCESS_CHI2:
            bad[order[:count]] = True
            break
    for number in bad.nonzero()[:, 0].tolist():
        same = sum(kind == kinds[number] and not odd for kind, odd in zip(kinds, bad.tolist(), strict=True))
        if same < MIN_CAPTURES_OF_KIND:
            bad[number] = False
    return bad


def suspicious(misfit: torch.Tensor, most: int) -> torch.Tensor:
    """Return ``(N,)`` bool: captures without which the search should be repeated.

    A model that was fitted with a bad capture has too much noise and wrong effects, so that only the order of the
    captures' misfits counts, and no absolute value.

    Args:
        misfit: ``(N,)``, see :func:`misfit_by_capture`.
        most: how many captures may be called bad.
    """
    order = misfit.argsort(descending=True)
    odd = torch.zeros(len(misfit), dtype=torch.bool)
    common = float(misfit.median())
    gaps = [
        float(misfit[order[count - 1]] / misfit[order[count]]) for count in range(1, min(most, len(misfit) - 1) + 1)
    ]
    if gaps and max(gaps) >= MIN_SUSPICIOUS_RATIO:
        count = 1 + max(range(len(gaps)), key=gaps.__getitem__)
        if float(misfit[order[count - 1]]) >= MIN_SUSPICIOUS_RATIO * common:
            odd[order[:count]] = True
    return odd
