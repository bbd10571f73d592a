"""A displacement of the mask's image that is far from every start is found by correlation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Setting, datasheet_noise
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.search.displacement import far_displacements
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera

FAR = {"mask_shift": {"dx": 12.3, "dy": -0.4}}


def captures(hidden: dict[str, Any], size: int = 48) -> Captures:
    return VirtualCamera(Session(size=(size, size)), hidden).capture(5)


def proposed(hidden: dict[str, Any]) -> dict[str, list[Setting]]:
    observation = observe(captures(hidden))
    fitter = Fitter(CameraModel(observation, vocabulary()), split(observation))
    return far_displacements(fitter.fit(datasheet_noise(observation)[0]))


@pytest.mark.parametrize("beside", [{}, {"gain": {"factor": 0.8}, "mask_contrast": {"leak": 0.1}}])
def test_a_far_displacement_is_proposed(beside: dict[str, Any]) -> None:
    (starts,) = proposed({**FAR, **beside}).values()
    assert any(abs(float(one["dx"]) - 12.3) < 1 and abs(float(one["dy"]) + 0.4) < 1 for one in starts)


def test_none_is_proposed_beyond_what_the_effect_takes() -> None:
    """A displacement of 31.6 pixels is proposed on the side below 32 alone: the search must not end over the others."""
    observation = observe(captures({}, size=96))
    moved = replace(observation, patterns=observation.patterns.roll(-32, -1))
    fitter = Fitter(CameraModel(moved, vocabulary()), split(moved))
    (starts,) = far_displacements(fitter.fit(datasheet_noise(moved)[0])).values()
    assert starts and all(31 < float(one["dx"]) <= vocabulary()["mask_shift"].about["dx"].high for one in starts)


@pytest.mark.parametrize(
    "hidden",
    [
        {},
        {"mask_shift": {"dx": 0.6, "dy": -0.35}},
        {"pattern_order": {"offset": 2}},
        {"mask_orientation": {"operation": "rot180"}},
        {"optical_blur": {"sigma": 1.0}},
    ],
)
def test_otherwise_none_is(hidden: dict[str, Any]) -> None:
    assert not any(proposed(hidden).values())


def test_it_costs_its_rows_and_not_the_diagnosis() -> None:
    few = ("mask_shift", "mask_scale", "mask_blur", "gain", "pattern_order", "shot_noise", "read_noise")
    result = diagnose(captures(FAR, size=64), {name: vocabulary()[name] for name in few})
    assert result.names == ("mask_shift",) and result.verdict == "explained"
    (effect,) = describe(result)["effects"]
    for name, value in FAR["mask_shift"].items():
        estimate = effect["parameters"][name]
        assert abs(estimate["value"] - value) < 5 * estimate["std"] < 0.05
    border = describe(result)["split"]["border"]
    assert 13 <= border["left"] <= 16 and max(border["top"], border["right"], border["bottom"]) <= 4  # others need 3


def test_the_other_side_of_a_whole_displacement_is_screened() -> None:
    """Truth lies at 0.7, where the start at 1.2 looks nearer than that at 0.4 and leads to another maximum."""
    session = Session(size=(32, 32), frames=4, mask="binary", aperture=0.28, dark=2, flat=4, static=4, dynamic=4)
    recorded = VirtualCamera(session, {"mask_shift": {"dx": 0.7, "dy": -0.4}}).capture(seed=3)
    result = diagnose(recorded, {name: vocabulary()[name] for name in ("mask_shift", "shot_noise", "read_noise")})
    (shift,) = result.effects
    assert shift.parameters["dx"].value == pytest.approx(0.7, abs=0.01)
    assert shift.parameters["dy"].value == pytest.approx(-0.4, abs=0.01)
