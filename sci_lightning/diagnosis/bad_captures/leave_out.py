"""Explaining captures of which a few may be bad: they are found, left out, and the search goes on without them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import torch

from sci_lightning.diagnosis.bad_captures.appearance import appearance
from sci_lightning.diagnosis.bad_captures.suspects import (
    misfit_by_capture,
    most_bad,
    outlying,
    suspects,
    suspicious,
)
from sci_lightning.diagnosis.fit.budget import Budget
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import NOISE_GUESS, Hypothesis
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search.remaining_misfit import quantified
from sci_lightning.diagnosis.search.screening import screen
from sci_lightning.diagnosis.search.search import Explanation, explain, ideal_camera
from sci_lightning.diagnosis.search.selection import OnProgress
from sci_lightning.diagnosis.search_settings import SearchSettings

MAX_SEARCHES = 3
"""Searches in which it must become clear which captures are bad; else none is called so."""
MAX_LEFT_BY_AN_EFFECT_SHARE = 0.2
"""Part of a capture's excess of chi2 that one more effect may leave to count as its explanation."""


Role = Literal["fits and choices", "verification"]
"""What a capture would have been used for: see :mod:`~sci_lightning.diagnosis.fit.split`."""


@dataclass(frozen=True)
class BadCapture:
    """A capture that contradicts all others, and is therefore left out.

    Attributes:
        number: of the capture in the file, from 0.
        kind: of the capture by its label.
        role: what it would have been used for.
        chi2: mean square of its residuals, clipped, under the model of the other captures; 1 for a capture that fits.
        others_chi2: the largest such number of all other captures.
        appearance: what it looks like, a clause such as "its sequence looks like that of capture 12".
    """

    number: int
    kind: str
    role: Role
    chi2: float
    others_chi2: float
    appearance: str

    @property
    def sentence(self) -> str:
        """What a report says about it."""
        role = ", kept for verification" if self.role == "verification" else ""
        return f"capture {self.number} ({self.kind}{role}) does not fit the others: {self.appearance}"

    def describe(self) -> dict[str, Any]:
        """Return the capture as it stands in ``report.json``."""
        return {
            "capture": self.number,
            "kind": self.kind,
            "role": self.role,
            "chi2": self.chi2,
            "others_chi2": self.others_chi2,
            "sentence": self.sentence,
        }


def explain_without_bad_captures(
    whole: CameraModel, settings: SearchSettings, budget: Budget, on_progress: OnProgress
) -> tuple[Explanation, tuple[BadCapture, ...]]:
    """Search for the effects that explain the captures, without captures that contradict the others.

    A quick look before the search (:func:`~.suspects.suspects`) says without which captures it begins. After it, every
    capture is compared with the model that was fitted without it: suspects that fit are taken back, and captures that
    do not fit are left out, and the search is repeated until both agree.

    Args:
        whole: the model with all captures for fits and choices.
        settings: thresholds.
        budget: processor time for all searches together.
        on_progress: called with a one-line message after every step of the search.

    Returns:
        the model of the captures that agree with each other, and the captures that do not agree with them.
    """
    observation = whole.observation
    ideal = ideal_camera(whole, settings, budget)
    most = most_bad(len(observation))
    left_out = suspects(ideal) if settings.find_bad_captures else torch.zeros(len(observation), dtype=torch.bool)
    nobody = torch.zeros_like(left_out)
    searched: dict[tuple[bool, ...], Explanation] = {}
    for _ in range(MAX_SEARCHES):
        start = ideal
        if left_out.any():
            numbers = ", ".join(map(str, sorted(observation.number[left_out].tolist())))
            on_progress(f"search without capture{'s' * (int(left_out.sum()) > 1)} {numbers}")
            start = ideal_camera(whole.of_captures(observation.take(~left_out)), settings, budget)
        explanation = searched[tuple(left_out.tolist())] = explain(start, on_progress)
        if not settings.find_bad_captures:
            return explanation, ()
        misfit = misfit_by_capture(explanation.fit, observation)
        if left_out.any():
            odd = outlying(misfit, observation.kinds, most)
            if bool((odd == left_out).all()):
                odd = unexplained(explanation.fit, observation, misfit, odd)
        else:
            odd = suspicious(misfit, most)
        if bool((odd == left_out).all()):
            return explanation, describe(explanation.fit, observation, misfit, odd, "fits and choices")
        left_out = odd
        if tuple(odd.tolist()) in searched or not budget.allows("a search with other captures"):
            break
    key = tuple(nobody.tolist())
    if key not in searched:
        enough = budget.allows("a search with all captures")
        searched[key] = explain(ideal, on_progress) if enough else fitted_to_all(explanation, ideal)
    return searched[key], ()


def fitted_to_all(explanation: Explanation, ideal: Fit) -> Explanation:
    """Return what a search over some captures found, fitted to those of the ideal camera, where there is no time left
    to search again."""
    hypothesis, model = explanation.fit.hypothesis, ideal.fitter.model
    maps = {name: values for name, values in hypothesis.maps.items() if not model.effects[name].of_captures}
    fitter = ideal.fitter.covering(hypothesis)
    fit = fitter.fit(Hypothesis(hypothesis.effects, maps), iterations=20, fixed=explanation.fit.fixed)
    unnamed = tuple(quantified(fit, one) for one in explanation.unnamed)
    return replace(explanation, ideal=fitter.repeated(ideal), fit=fit, unnamed=unnamed)


def unexplained(fit: Fit, observation: Observation, misfit: torch.Tensor, odd: torch.Tensor) -> torch.Tensor:
    """Return which odd captures no single further effect explains together with the others, ``(N,)`` bool.

    A capture may be the only one that shows an effect. Then the effect is missing, and the capture is not bad.

    Args:
        fit: the model of the other captures.
        observation: N captures, the odd ones among them.
        misfit: ``(N,)`` of the captures by the model.
        odd: ``(N,)`` bool.
    """
    bad = odd.clone()
    for number in odd.nonzero()[:, 0].tolist():
        together = ~odd
        together[number] = True
        others = misfit[~odd].max()
        fitter = fit.fitter.of_captures(observation.take(together), fitted=True)
        place = int(together[:number].sum())
        noise = tuple((name, parameter) for name, (parameter, _) in NOISE_GUESS.items())
        base = fitter.fit(fit.hypothesis, fixed=noise, iterations=4)
        for candidate in screen(base)[: fitter.settings.candidates_fitted]:
            larger = fitter.fit(candidate.added(fitter.model, base.hypothesis), fixed=noise)
            after = misfit_by_capture(larger, fitter.model.observation)
            enough = after[place] - 1 <= MAX_LEFT_BY_AN_EFFECT_SHARE * (misfit[number] - 1)
            if enough and after.max() <= max(float(others), float(after[place])) + MAX_LEFT_BY_AN_EFFECT_SHARE:
                bad[number] = False
                break
    return bad


def describe(
    fit: Fit, observation: Observation, misfit: torch.Tensor, bad: torch.Tensor, role: Role
) -> tuple[BadCapture, ...]:
    """Return the bad captures of an observation as reports name them, in the order of the file."""
    if not bad.any():
        return ()
    others = float(misfit[~bad].max())
    captures = []
    for place in bad.nonzero()[:, 0].tolist():
        looks = appearance(fit, observation, place, ~bad)
        number = int(observation.number[place])
        captures.append(BadCapture(number, observation.kinds[place], role, float(misfit[place]), others, looks))
    return tuple(sorted(captures, key=lambda capture: capture.number))


def bad_verification_captures(
    fit: Fit, seen: Observation, unseen: Observation, everything: Observation
) -> tuple[torch.Tensor, tuple[BadCapture, ...]]:
    """Compare the verification captures with the model: which of them contradict all others, seen or unseen?

    Args:
        fit: the model, which has not seen them.
        seen: the captures that it was fitted to and that agree with it.
        unseen: V verification captures.
        everything: all captures of the file, from which the two were taken.

    Returns:
        ``(V,)`` bool, and the bad ones as reports name them.
    """
    numbers = torch.cat((seen.number, unseen.number))
    compared = everything.take(torch.isin(everything.number, numbers))
    misfit = misfit_by_capture(fit, compared)
    odd = outlying(misfit, compared.kinds, most_bad(len(compared)))
    odd &= torch.isin(compared.number, unseen.number)
    odd = unexplained(fit, compared, misfit, odd)
    bad = torch.isin(unseen.number, compared.number[odd])
    return bad, describe(fit, compared, misfit, odd, "verification")
