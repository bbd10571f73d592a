"""Parts of a field show displacement, rotation and magnification of the mask's image at once."""

from __future__ import annotations

from typing import Any

import pytest

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.blind_fit import BlindFitter
from sci_lightning.diagnosis.blind.displacement import first_pose
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior
from sci_lightning.diagnosis.blind.search import BlindSearch
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting, datasheet_noise
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera

SHARE = 0.375


def snapshots(hidden: dict[str, Any], side: int = 128, mask: str = "binary") -> Captures:
    """Return snapshots of moving scenes, four slots."""
    silent = {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0}
    session = Session(**silent, size=(side, side), frames=4, mask=mask, unknown=4, aperture=0.28, surround="goes_on")
    return VirtualCamera(session, hidden).capture(seed=5)


def likelihood_of(captures: Captures) -> tuple[BlindLikelihood, Hypothesis]:
    observation = observe_snapshots(captures)
    model = CameraModel(observation, vocabulary(), {})
    return BlindLikelihood(model, ScenePrior(observation.frames)), datasheet_noise(observation)[0]


def pose_of(captures: Captures) -> dict[str, Setting]:
    likelihood, ideal = likelihood_of(captures)
    return first_pose(likelihood, ideal, SHARE)


@pytest.mark.parametrize("sigma", [0.3, 1.5])
def test_a_displacement_and_a_rotation_at_once(sigma: float) -> None:
    """Neither a blur nor an offset of the sensor hides them."""
    hidden = {"mask_shift": {"dx": 2.4, "dy": -1.3}, "mask_rotation": {"angle": 0.8}, "mask_blur": {"sigma": sigma}}
    pose = pose_of(snapshots({**hidden, "black_level": {"offset": 0.05}}))
    assert set(pose) == {"mask_shift", "mask_rotation"}
    assert pose["mask_shift"]["dx"] == pytest.approx(2.4, abs=0.2)
    assert pose["mask_shift"]["dy"] == pytest.approx(-1.3, abs=0.2)
    assert pose["mask_rotation"]["angle"] == pytest.approx(0.8, abs=0.15)


def test_a_magnification() -> None:
    pose = pose_of(snapshots({"mask_scale": {"scale": 1.02}}))
    assert pose["mask_scale"]["scale"] == pytest.approx(1.02, abs=0.004)


def test_a_small_field_shows_a_displacement_alone() -> None:
    hidden = {"mask_shift": {"dx": 2.4, "dy": -1.3}, "mask_rotation": {"angle": 0.5}, "mask_blur": {"sigma": 1.2}}
    pose = pose_of(snapshots({**hidden, "black_level": {"offset": 0.05}}, side=96))
    assert set(pose) == {"mask_shift"}
    assert pose["mask_shift"]["dx"] == pytest.approx(2.4, abs=0.2)
    assert pose["mask_shift"]["dy"] == pytest.approx(-1.3, abs=0.2)


def test_nothing_is_shown_by_an_even_sum() -> None:
    assert pose_of(snapshots({"mask_shift": {"dx": 2.4, "dy": -1.3}}, mask="structural")) == {}


@pytest.mark.slow
def test_nothing_is_begun_with_where_nothing_is_displaced() -> None:
    """The parts show a displacement next to none, which has no support; nor has what is fitted beside it."""
    likelihood, ideal = likelihood_of(snapshots({}))
    search = BlindSearch(BlindFitter(likelihood), ideal, SearchSettings(), lambda message: None)
    begun = search._posed(search.fitter.evaluate(ideal, search.fitted_blocks))
    assert set(begun.hypothesis.effects) == set(ideal.effects)


def is_near(hypothesis: Hypothesis, hidden: dict[str, Any]) -> None:
    for name, setting in hidden.items():
        for key, value in setting.items():
            assert hypothesis.effects[name][key] == pytest.approx(value, rel=0.15, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "hidden",
    [
        {"mask_rotation": {"angle": 0.8}, "black_level": {"offset": 0.05}},
        {"mask_scale": {"scale": 1.02}, "mask_blur": {"sigma": 0.4}},
        {"mask_distortion": {"k": -0.012}, "mask_blur": {"sigma": 0.4}},
        {"mask_distortion": {"k": 0.0127}},
    ],
    ids=" ".join,
)
def test_what_the_search_begins_with(hidden: dict[str, Any]) -> None:
    """A distortion is told from the magnification that parts of the field show."""
    likelihood, ideal = likelihood_of(snapshots(hidden))
    search = BlindSearch(BlindFitter(likelihood), ideal, SearchSettings(), lambda message: None)
    begun = search._posed(search.fitter.evaluate(ideal, search.fitted_blocks))
    assert set(begun.hypothesis.effects) - set(ideal.effects) == set(hidden)
    is_near(begun.hypothesis, hidden)


@pytest.mark.slow
@pytest.mark.parametrize(
    "hidden",
    [
        {"mask_rotation": {"angle": 0.8}, "mask_contrast": {"leak": 0.1}},
        {"mask_scale": {"scale": 1.02}, "mask_blur": {"sigma": 0.4}},
        {"mask_distortion": {"k": 0.0127}},
    ],
    ids=" ".join,
)
def test_what_the_search_ends_with(hidden: dict[str, Any]) -> None:
    """A leak is told from a black level, wherever the search began; scenes that move unlike the prior are no delay."""
    likelihood, ideal = likelihood_of(snapshots(hidden))
    explanation = BlindSearch(BlindFitter(likelihood), ideal, SearchSettings(), lambda message: None).run()
    assert {one.name for one in explanation.named} == set(hidden)
    is_near(explanation.fit.hypothesis, hidden)
