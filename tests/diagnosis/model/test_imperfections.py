"""Errors of a laboratory are estimated, reported and blamed on no camera; their algebra is that of whole matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.capture_map import CaptureMap
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.model.imperfections import imperfections_of
from sci_lightning.diagnosis.model.map_system import MapSystem
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.report.sentences import laboratory
from sci_lightning.diagnosis.search.search import ideal_camera
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.border import Border
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check

JITTER = 0.005
FEW = {
    name: vocabulary()[name] for name in ("gain", "black_level", "mask_shift", "flicker", "shot_noise", "read_noise")
}


def jittered(captures: Captures, seed: int = 1) -> Captures:
    """Captures whose exposures differ from nominal, each by its own factor."""
    factors = 1 + JITTER * np.random.default_rng(seed).standard_normal(len(captures.measurement))
    dn = np.rint(captures.measurement * factors[:, None, None]).clip(0, captures.full_scale)
    return replace(captures, measurement=dn.astype(captures.measurement.dtype))


def test_jitter_is_the_laboratorys() -> None:
    captures = VirtualCamera(Session(size=(32, 32), surround="dark"), {}).capture(3)
    result = diagnose(jittered(captures), FEW)
    assert (result.names, result.verdict) == ((), "consistent")
    (jitter,) = (error for error in result.imperfections if error.name == "exposure_jitter")
    estimate = jitter.parameters["std"]
    assert abs(float(estimate.value) - JITTER) < 4 * estimate.std < JITTER
    assert "exposures jitter by" in laboratory(result)
    report = describe(result)
    check("report", report)
    assert "exposure_jitter" in [error["name"] for error in report["imperfections"]]
    assert diagnose(captures, FEW).imperfections == ()


def test_a_gain_beside_jitter_is_named_with_its_error() -> None:
    captures = VirtualCamera(Session(size=(32, 32), surround="dark"), {"gain": {"factor": 0.93}}).capture(4)
    result = diagnose(jittered(captures), FEW)
    (gain,) = (effect for effect in result.effects if effect.name == "gain")
    estimate = gain.parameters["factor"]
    assert JITTER / 10 < estimate.std < JITTER and abs(float(estimate.value) - 0.93) < 4 * estimate.std
    assert result.verdict == "explained"


def test_pixels_that_have_not_counted_before() -> None:
    """Errors of targets know nothing about them yet, and no number of the camera takes their place."""
    observation = observe(jittered(VirtualCamera(Session(size=(32, 32)), {"gain": {"factor": 0.93}}).capture(4)))
    model = CameraModel(observation, FEW, imperfections=imperfections_of(observation))
    whole = ideal_camera(model, SearchSettings()).fitter
    start = model.with_imperfections(datasheet_noise(observation)[0].with_effect("gain", {"factor": 0.93}))
    narrow, direct = whole.with_border(Border(6, 6, 6, 6)).fit(start, 30), whole.fit(start, 30)
    wide = whole.repeated(narrow)
    assert wide.fitter.pixels > narrow.fitter.pixels
    assert wide.log_likelihood == pytest.approx(direct.log_likelihood, abs=5)
    assert wide.hypothesis.effects["gain"]["factor"] == pytest.approx(
        direct.hypothesis.effects["gain"]["factor"], abs=1e-3
    )


@pytest.fixture(scope="module")
def system() -> MapSystem:
    """Of a gain map of the pixels, of the columns, and of all errors of a laboratory."""
    observation = observe(VirtualCamera(Session(size=(16, 18)), {}).capture(2))
    names = {name: vocabulary()[name] for name in ("prnu", "column_noise", "shot_noise", "read_noise")}
    model = CameraModel(observation, names, imperfections=imperfections_of(observation))
    fitter = ideal_camera(model, SearchSettings()).fitter
    hypothesis = model.with_imperfections(datasheet_noise(observation)[0])
    for name in ("prnu", "column_noise"):
        hypothesis = hypothesis.with_effect(name, {"std": 0.01}, model.zero_map(name))
    at = fitter.evaluate(hypothesis)
    maps = [replace(one, std=0.01) for one in fitter.maps(at)]
    assert {one.kind for one in maps} == {"pixel", "column", "capture"}
    return MapSystem(maps, at.likelihood.mean_information * fitter.fitted)


def test_the_inverse_is_that_of_the_whole_matrix(system: MapSystem) -> None:
    """Every value of every map is moved by itself: the sum over the pixels gives the matrix that was inverted."""
    columns = []
    for one in system.maps:
        for unit in torch.eye(one.values.numel(), dtype=torch.float64):
            columns.append((one.spread(unit.reshape(one.values.shape)) * one.jacobian).expand(one.jacobian.shape))
    changes = torch.stack(columns).flatten(1).double()
    prior = torch.cat([torch.full((one.values.numel(),), one.std**-2.0).double() for one in system.maps])
    weight = system.information.flatten().double()
    matrix = (changes * weight) @ changes.T + prior.diag()
    right = torch.randn(3, len(matrix), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    np.testing.assert_allclose(system.solve(right), torch.linalg.solve(matrix, right.T).T, rtol=2e-3, atol=1e-7)
    jitter = next(one for one in system.maps if one.name == "exposure_jitter")
    assert isinstance(jitter, CaptureMap)
    places = [one.name for one in system.maps for _ in range(one.values.numel())]
    some = torch.tensor([name == jitter.name for name in places])
    covariance = torch.linalg.inv(matrix)[some][:, some]
    own = torch.linalg.inv(system.own_precision(jitter))
    np.testing.assert_allclose(own, covariance, rtol=5e-3, atol=1e-8)
