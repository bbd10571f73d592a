"""Which captures do not fit the others: a decision by the misfit of every single capture."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import residuals
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.fit.verification import transferred
from sci_lightning.diagnosis.model.observation import Observation

CLIP = 6.0
"""Standard deviations at which residuals are clipped: a few odd pixels do not make a capture odd."""
ODD = 0.5
"""Excess of chi2 over 1 from which a capture may be called bad."""
FACTOR = 5.0
"""How many times the largest excess of the other captures it must have as well: formulas are a little inexact."""
FITS = 3.0
"""Largest chi2 of the other captures. If they do not fit either, an effect is missing, and nobody is to be accused."""
COMPANIONS = 2
"""Captures of the same kind that must fit: the only one of its kind may show what no other capture can show."""
SUSPICIOUS = 3.0
"""How many times as large as the median of all and as the next one a misfit is that a search is repeated without."""


def misfit_by_capture(fitter: Fitter, fit: Fit, observation: Observation, seed: int = 0) -> torch.Tensor:
    """Return the mean square of the clipped residuals of every capture, ``(N,)`` float64; about 1 for a right fit.

    Args:
        fitter: made the fit, and knows which pixels count.
        fit: the model.
        observation: captures of the same camera, whether the fit has seen them or not.
        seed: of the residuals' randomisation.
    """
    judge = judge_of(fitter, observation)
    moved = transferred(judge, fit)
    prediction = judge.with_map_uncertainty(moved.prediction, moved.maps)
    residual = residuals(judge, prediction, seed)
    return residual.clamp(-CLIP, CLIP).square().mean((1, 2), dtype=torch.float64)


def judge_of(fitter: Fitter, observation: Observation) -> Fitter:
    """Return a fitter of other captures of the same camera that sees every pixel that counts for ``fitter``."""
    split = Split(
        torch.ones_like(observation.dn, dtype=torch.bool),
        (),
        torch.zeros(len(observation), dtype=torch.bool),
        border=fitter.split.border,
    )
    return Fitter(fitter.model.of_captures(observation), split, fitter.settings)


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
        if worst <= FITS and least - 1 >= FACTOR * (worst - 1) + ODD:
            bad[order[:count]] = True
            break
    for number in bad.nonzero()[:, 0].tolist():
        same = sum(kind == kinds[number] and not odd for kind, odd in zip(kinds, bad.tolist(), strict=True))
        if same < COMPANIONS:
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
    if gaps and max(gaps) >= SUSPICIOUS:
        count = 1 + max(range(len(gaps)), key=gaps.__getitem__)
        if float(misfit[order[count - 1]]) >= SUSPICIOUS * common:
            odd[order[:count]] = True
    return odd
