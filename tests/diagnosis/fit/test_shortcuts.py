"""Shortcuts of fits change how long they take, not what comes out."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.fit import fit
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.border import Border
from sci_lightning.virtual_camera import Session, VirtualCamera

NOISE = Hypothesis({"shot_noise": {"full_well": 1e4}, "read_noise": {"std": 0.8}})
HIDDEN = {"mask_shift": {"dx": 0.61, "dy": -0.35}, "prnu": {"std": 0.04}}
FEW = ("mask_shift", "mask_rotation", "gain", "prnu", "column_noise", "shot_noise", "read_noise")


@pytest.fixture(scope="module")
def fitter() -> Fitter:
    observation = observe(VirtualCamera(Session(size=(32, 32)), HIDDEN).capture(3))
    return Fitter(CameraModel(observation, vocabulary()), split(observation)).with_border(Border.around(3.0))


def test_a_fit_that_cannot_win_is_abandoned(fitter: Fitter) -> None:
    start = NOISE.with_effect("mask_shift", {"dx": 0.4, "dy": -0.4})
    right = fitter.fit(start)
    wrong = NOISE.with_effect("mask_rotation", {"angle": 0.4})
    alone, hopeless = fitter.fit(wrong), fitter.fit(wrong, to_reach=right.fitted_log_likelihood - 60)
    assert hopeless.abandoned and not alone.abandoned
    assert hopeless.fitted_log_likelihood <= alone.fitted_log_likelihood < right.fitted_log_likelihood - 60
    asked = fitter.fit(start, to_reach=right.fitted_log_likelihood - 1)
    assert not asked.abandoned and asked.fitted_log_likelihood == right.fitted_log_likelihood
    beyond = fitter.fit(NOISE.with_effect("mask_shift", {"dx": 5.0, "dy": 0.0}), 1, to_reach=0.0)
    assert not beyond.abandoned  # it is judged by pixels that it cannot know


def test_a_part_of_the_pixels_is_predicted_as_in_the_whole(fitter: Fitter) -> None:
    maps = {"prnu": 0.04 * torch.randn(32, 32, generator=torch.Generator().manual_seed(1))}
    hypothesis = replace(
        NOISE.with_effect("vignetting", {"strength": 0.2}).with_effect("prnu", {"std": 0.04}), maps=maps
    )
    border, model = Border(top=3, right=1, bottom=2, left=5), fitter.model
    whole = model.inside(Border()).predict(hypothesis)
    for stride in (1, 3):
        part = model.inside(border, stride).predict(hypothesis)
        assert torch.equal(part.mean, whole.mean[:, 3:30:stride, 5:31:stride])
        assert torch.equal(part.deviation, whole.deviation[:, 3:30:stride, 5:31:stride])
    view = model.inside(border, 3)
    assert torch.equal(view.windowed(view.whole(part.mean)), part.mean)


@pytest.mark.slow
def test_the_way_begins_on_a_part_of_the_pixels_and_ends_on_all(monkeypatch: pytest.MonkeyPatch) -> None:
    captures = VirtualCamera(Session(size=(32, 32)), HIDDEN).capture(3)
    few = {name: vocabulary()[name] for name in FEW}
    exact = diagnose(captures, few)
    monkeypatch.setattr(fit, "COARSE_PIXELS", 1500)
    coarse = diagnose(captures, few)
    assert coarse.names == exact.names == ("mask_shift", "prnu") and coarse.verdict == exact.verdict == "explained"
    for one, other in zip(coarse.effects, exact.effects, strict=True):
        for name, estimate in one.parameters.items():
            assert abs(float(estimate.value) - float(other.parameters[name].value)) < 0.2 * estimate.std
    assert abs(coarse.after.fit.log_likelihood - exact.after.fit.log_likelihood) < 0.2
    part = Fitter(coarse.model, coarse.split).coarse
    assert part is not None and part.coarse is None and float(part.fitted.sum()) <= 1500
