"""Questions to the residuals: silent when the model is right, and each heard by what it is meant for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.residual_tests import Residuals, ResidualTest
from sci_lightning.diagnosis.residual_tests.all_tests import QUESTIONS, residual_tests
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera

SMALL = {"dark": 2, "flat": 3, "all_on": 1, "all_off": 1, "static": 2, "dynamic": 3}


def ideal(path: Path, hidden: Any = None, seed: int = 3, **session: Any) -> Fit:
    """The ideal camera with the datasheet's noise, for captures in which something is hidden."""
    VirtualCamera(Session(**{"size": (32, 32), **session}), hidden).write(path, seed=seed)
    observation = observe(read_captures(path))
    subject = Fitter(CameraModel(observation, vocabulary()), split(observation))
    noise, fixed = datasheet_noise(observation)
    return subject.fit(noise, fixed=fixed, iterations=30)


def answers(fit: Fit, seed: int = 0) -> list[ResidualTest]:
    return residual_tests(Residuals.of(fit, seed))


def significant(tests: list[ResidualTest]) -> set[str]:
    return {test.name for test in tests if test.significant}


def assert_uniform_enough(p_values: list[list[float]]) -> None:
    """p-values of a right model are as small as they say, or less often."""
    result = np.array(p_values)
    assert (result < 0.001).mean() < 0.004
    assert (result < 0.01).mean() < 0.015
    assert result.min() > 1e-3 / result.size
    assert (result.mean(0) > 0.5 - 4 / np.sqrt(12 * len(result))).all()  # the mean of so many uniform numbers


def test_p_values_of_standard_normal_residuals(tmp_path: Path) -> None:
    fit = ideal(tmp_path / "a.h5", **SMALL)
    p_values = []
    for seed in range(60):
        residuals = Residuals.of(fit, seed)
        noise = torch.randn(residuals.raw.shape, generator=torch.Generator().manual_seed(seed))
        tests = residual_tests(Residuals(fit, noise, residuals.prediction, seed))
        p_values.append([each.p_value for each in tests])
    assert_uniform_enough(p_values)


def test_p_values_of_a_camera_in_which_nothing_is_hidden(tmp_path: Path) -> None:
    p_values = []
    for seed in range(25):
        session = SMALL | {"bit_depth": 8 + 2 * (seed % 3), "mask": ("structural", "binary")[seed % 2]}
        tests = answers(ideal(tmp_path / "a.h5", seed=seed, full_well_e=2000.0, **session), seed)
        assert not significant(tests)
        p_values.append([each.p_value for each in tests])
    assert_uniform_enough(p_values)


@pytest.mark.parametrize(
    ("hidden", "name"),
    [
        ("gain", "light"),
        ("veiling_glare", "light"),
        ("s_shaped_response", "intensity"),
        ("vignetting", "radius"),
        ("sensor_dust", "blocks"),
        ("interlaced_gain", "rows"),
        ("column_noise", "columns"),
        ("hot_pixels", "pixels"),
        ("prnu", "pixels"),
        ("flicker", "slots"),
        ("short_slot", "patterns"),
        ("pattern_order", "delays"),
        ("mask_lag", "delays"),
        ("swapped_patterns", "swaps"),
        ("rolling_shutter", "swaps"),
        ("mask_shift", "mask_edges"),
        ("mask_rotation", "mask_edges"),
        ("optical_blur", "image_edges"),
        ("row_noise", "frequency"),
        ("ghost", "copies"),
        ("black_level", "kinds"),
        ("saturation", "captures"),
        ("drifting_source", "drift"),
        ("shot_noise", "variance_by_intensity"),
        ("read_noise", "distribution"),
        ("bit_depth", "codes"),
    ],
)
def test_a_question_hears_what_it_is_meant_for(hidden: str, name: str, tmp_path: Path) -> None:
    assert name in significant(answers(ideal(tmp_path / "a.h5", hidden)))


def test_noise_that_is_stated_wrongly_shows_in_the_variance_alone(tmp_path: Path) -> None:
    hidden = {"read_noise": {"std": 1.2}}
    tests = answers(ideal(tmp_path / "a.h5", hidden, dark=0, all_off=0, pattern=0))
    assert {test.about for test in tests if test.significant} == {"variance"}


def test_codes_that_a_converter_of_fewer_bits_cannot_give_are_not_missed(tmp_path: Path) -> None:
    fit = ideal(tmp_path / "a.h5", {"bit_depth": {"bits": 6}})
    assert not significant(answers(fit.fitter.fit(fit.hypothesis.with_effect("bit_depth", {"bits": 6}))))


def test_what_a_capture_leaves_in_the_next(tmp_path: Path) -> None:
    fit = ideal(tmp_path / "a.h5")
    residuals = Residuals.of(fit, seed=0)
    number = fit.fitter.model.observation.number
    before = residuals.prediction.mean[number.argsort()].roll(1, 0)[number.argsort().argsort()]
    left = residuals.raw + 0.005 * before / residuals.prediction.deviation
    assert "carry_over" in significant(residual_tests(Residuals(fit, left, residuals.prediction, seed=0)))


@pytest.mark.parametrize(
    ("hidden", "name", "right"),
    [
        ("prnu", "prnu", True),
        ("sensor_dust", "prnu", False),
        ("vignetting", "prnu", False),
        ("interlaced_gain", "prnu", False),
        ("column_noise", "column_noise", True),
        ("dead_column", "column_noise", False),
    ],
)
def test_a_map_that_is_not_what_it_is_called(hidden: str, name: str, right: bool, tmp_path: Path) -> None:
    fit = ideal(tmp_path / "a.h5", hidden, size=(48, 48))
    shape = fit.fitter.model.vocabulary[name].shape(fit.fitter.model.observation.size)  # type: ignore[attr-defined]
    fit = fit.fitter.fit(fit.hypothesis.with_effect(name, {"std": 0.01}, torch.zeros(shape)), iterations=20)
    assert (f"map_of_{name}" not in significant(answers(fit))) == right


@pytest.mark.parametrize("size", [(33, 47), (16, 16), (40, 100)])
def test_few_captures_of_any_size(size: tuple[int, int], tmp_path: Path) -> None:
    few = {"dark": 0, "flat": 1, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 1}
    tests = answers(ideal(tmp_path / "a.h5", size=size, **few))
    assert not significant(tests)
    assert [test.name for test in tests] == list(QUESTIONS)


def test_the_order_of_the_captures_matters_only_where_it_is_asked_for(tmp_path: Path) -> None:
    VirtualCamera(Session(size=(32, 32), **SMALL)).write(tmp_path / "a.h5", seed=1)
    captures = read_captures(tmp_path / "a.h5")
    result = []
    for each in (captures, captures.take(list(range(len(captures)))[::-1])):
        observation = observe(each)
        subject = Fitter(CameraModel(observation, vocabulary()), split(observation))
        tests = answers(subject.fit(datasheet_noise(observation)[0]), seed=0)
        result.append({test.name: test.p_value for test in tests if test.name not in ("drift", "carry_over")})
    assert result[0] == pytest.approx(result[1])
