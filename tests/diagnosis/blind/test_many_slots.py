"""Snapshots of more slots than the statistics of video reach over: scenes are smooth, and nothing else is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis, diagnose_blind
from sci_lightning.diagnosis.blind.prior import ScenePrior, statistics_for
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.errors import BadInput
from tests.diagnosis.blind.conftest import snapshots

SLOTS = 18
NAMES = ("mask_blur", "mask_shift", "mask_contrast", "optical_blur")
BLUR = {"mask_blur": {"sigma": 0.8}}


def diagnosed(hidden: dict[str, dict[str, float]]) -> BlindDiagnosis:
    captures = snapshots(hidden, frames=SLOTS, side=48)
    known = vocabulary()
    return diagnose_blind(captures, {name: known[name] for name in (*NAMES, "shot_noise", "read_noise")})


def test_too_many_slots() -> None:
    captures = snapshots(frames=33, side=24, count=1)
    twice = np.concatenate([captures.sequence, captures.sequence], axis=1)
    captures = replace(captures, sequence=twice, scene=np.full((1, 66, 24, 24), np.nan, np.float32))
    with pytest.raises(BadInput, match=r"66 slots, .* 64"):
        diagnose_blind(captures)


def test_scenes_are_known_less_well_than_behind_few() -> None:
    assert ScenePrior(SLOTS, statistics_for(SLOTS)).uncertainty_nats > ScenePrior(8).uncertainty_nats


@pytest.mark.slow
def test_blur() -> None:
    diagnosis = diagnosed(BLUR)
    assert diagnosis.names == ("mask_blur",) and diagnosis.verdict == "explained"
    (effect,) = diagnosis.effects
    estimate = effect.parameters["sigma"]
    assert abs(estimate.value - 0.8) < max(4 * estimate.std, 0.08)
    assert diagnosis.prediction is not None and diagnosis.prediction.mask_helps()
    assert "optical_blur" in diagnosis.undetermined


@pytest.mark.slow
def test_nothing() -> None:
    diagnosis = diagnosed({})
    assert diagnosis.names == () and diagnosis.verdict == "consistent"
