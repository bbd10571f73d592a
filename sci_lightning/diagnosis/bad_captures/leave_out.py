"""Explaining captures of which a few may be bad: they are found, left out, and the search goes on without them."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.bad_captures.appearance import appearance
from sci_lightning.diagnosis.bad_captures.bad_capture import BadCapture, Role
from sci_lightning.diagnosis.bad_captures.judgement import judge_of, misfit_by_capture, most_bad, outlying, suspicious
from sci_lightning.diagnosis.bad_captures.robust_screening import suspects
from sci_lightning.diagnosis.model.camera_model import NOISE_GUESS, CameraModel
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search.camera_explanation import Explained, explain, ideal_camera
from sci_lightning.diagnosis.search.screening import screen
from sci_lightning.diagnosis.search.search import OnProgress
from sci_lightning.diagnosis.search_settings import SearchSettings

SEARCHES = 3
"""Searches in which it must become clear which captures are bad; else none is called so."""
EXPLAINED = 0.2
"""Part of a capture's excess of chi2 that one more effect may leave to count as its explanation."""


@dataclass(frozen=True)
class Agreement:
    """Captures that agree with each other, and those that do not agree with them.

    Attributes:
        explained: the model of the former.
        bad: the latter.
    """

    explained: Explained
    bad: tuple[BadCapture, ...]


def explain_without_bad_captures(whole: CameraModel, settings: SearchSettings, on_progress: OnProgress) -> Agreement:
    """Search for the effects that explain the captures, without captures that contradict the others.

    A quick look before the search (:func:`~.robust_screening.suspects`) says without which captures it begins. After
    it, every capture is judged by the model that was fitted without it: suspects that fit are taken back, and captures
    that do not fit are left out, and the search is repeated until both agree.

    Args:
        whole: the model with all captures for fits and choices.
        settings: thresholds and budgets.
        on_progress: called with a one-line message after every step of the search.
    """
    observation = whole.observation
    fitter, ideal = ideal_camera(whole, settings)
    most = most_bad(len(observation))
    left_out = (
        suspects(fitter, ideal) if settings.find_bad_captures else torch.zeros(len(observation), dtype=torch.bool)
    )
    nobody = torch.zeros_like(left_out)
    searched: dict[tuple[bool, ...], Explained] = {}
    for _ in range(SEARCHES):
        start = fitter, ideal
        if left_out.any():
            numbers = ", ".join(map(str, sorted(observation.number[left_out].tolist())))
            on_progress(f"search without capture{'s' * (int(left_out.sum()) > 1)} {numbers}")
            start = ideal_camera(whole.of_captures(observation.take(~left_out)), settings)
        explained = searched[tuple(left_out.tolist())] = explain(*start, on_progress)
        if not settings.find_bad_captures:
            return Agreement(explained, ())
        misfit = misfit_by_capture(explained.fitter, explained.explanation.fit, observation)
        if left_out.any():
            odd = outlying(misfit, observation.kinds, most)
            if bool((odd == left_out).all()):
                odd = unexplained(explained, observation, misfit, odd)
        else:
            odd = suspicious(misfit, most)
        if bool((odd == left_out).all()):
            return Agreement(explained, describe(explained, observation, misfit, odd, "fits and choices"))
        left_out = odd
        if tuple(odd.tolist()) in searched:
            break
    key = tuple(nobody.tolist())
    if key not in searched:
        searched[key] = explain(fitter, ideal, on_progress)
    return Agreement(searched[key], ())


def unexplained(
    explained: Explained, observation: Observation, misfit: torch.Tensor, odd: torch.Tensor
) -> torch.Tensor:
    """Return which odd captures no single further effect explains together with the others, ``(N,)`` bool.

    A capture may be the only one that shows an effect. Then the effect is missing, and the capture is not bad.

    Args:
        explained: the model of the other captures.
        observation: N captures, the odd ones among them.
        misfit: ``(N,)`` of the captures by the model.
        odd: ``(N,)`` bool.
    """
    bad = odd.clone()
    for number in odd.nonzero()[:, 0].tolist():
        together = ~odd
        together[number] = True
        others = misfit[~odd].max()
        judge = judge_of(explained.fitter, observation.take(together))
        place = int(together[:number].sum())
        noise = tuple((name, parameter) for name, (parameter, _) in NOISE_GUESS.items())
        base = judge.fit(explained.explanation.fit.hypothesis, fixed=noise, iterations=4)
        for candidate in screen(judge, base)[: explained.fitter.settings.candidates_fitted]:
            fit = judge.fit(candidate.added(judge.model, base.hypothesis), fixed=noise)
            after = misfit_by_capture(judge, fit, judge.model.observation)
            enough = after[place] - 1 <= EXPLAINED * (misfit[number] - 1)
            if enough and after.max() <= max(float(others), float(after[place])) + EXPLAINED:
                bad[number] = False
                break
    return bad


def describe(
    explained: Explained, observation: Observation, misfit: torch.Tensor, bad: torch.Tensor, role: Role
) -> tuple[BadCapture, ...]:
    """Return the bad captures of an observation as reports name them, in the order of the file."""
    if not bad.any():
        return ()
    others = float(misfit[~bad].max())
    fit = explained.explanation.fit
    captures = []
    for place in bad.nonzero()[:, 0].tolist():
        looks = appearance(explained.fitter, fit, observation, place, ~bad)
        number = int(observation.number[place])
        captures.append(BadCapture(number, observation.kinds[place], role, float(misfit[place]), others, looks))
    return tuple(sorted(captures, key=lambda capture: capture.number))


def bad_verification_captures(
    explained: Explained, seen: Observation, unseen: Observation, everything: Observation
) -> tuple[torch.Tensor, tuple[BadCapture, ...]]:
    """Judge the verification captures: which of them contradict all others, seen or unseen?

    Args:
        explained: the model, which has not seen them.
        seen: the captures that it was fitted to and that agree with it.
        unseen: V verification captures.
        everything: all captures of the file, from which the two were taken.

    Returns:
        ``(V,)`` bool, and the bad ones as reports name them.
    """
    numbers = torch.cat((seen.number, unseen.number))
    judged = everything.take(torch.isin(everything.number, numbers))
    misfit = misfit_by_capture(explained.fitter, explained.explanation.fit, judged)
    odd = outlying(misfit, judged.kinds, most_bad(len(judged)))
    odd &= torch.isin(judged.number, unseen.number)
    odd = unexplained(explained, judged, misfit, odd)
    bad = torch.isin(unseen.number, judged.number[odd])
    return bad, describe(explained, judged, misfit, odd, "verification")
