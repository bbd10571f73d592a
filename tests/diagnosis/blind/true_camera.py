"""What snapshots say about effects when the search is given the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.blind_fit import BlindFitter
from sci_lightning.diagnosis.blind.candidate_comparison import FittedCandidate
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior, statistics_for
from sci_lightning.diagnosis.blind.search import BlindSearch
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary


def judged_by_truth(captures: Captures, truth: Mapping[str, Mapping[str, Any]], name: str) -> FittedCandidate:
    """Return an effect as a search would judge it that begins with the true camera.

    All effects are fitted together, from their true values; the effect is judged against the others without it, fitted
    from their true values as well. What is not clear then, no search can find.

    Args:
        captures: the snapshots.
        truth: parameters of everything that is hidden, by the names of effects.
        name: of the effect that is judged.
    """
    observation = observe_snapshots(captures)
    prior = ScenePrior(observation.frames, statistics_for(observation.frames))
    fitter = BlindFitter(BlindLikelihood(CameraModel(observation, vocabulary(), {}), prior))
    hypothesis = datasheet_noise(observation)[0]
    search = BlindSearch(fitter, hypothesis, SearchSettings(), lambda message: None)
    for effect, setting in truth.items():
        hypothesis = hypothesis.with_effect(effect, setting)
    fit = fitter.fit(hypothesis, search.fitted_blocks)
    without = fitter.fit(hypothesis.without(name), search.fitted_blocks)
    return search.assessor(fit, without, name)
