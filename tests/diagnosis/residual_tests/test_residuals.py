"""Residuals of a model with an estimated map are independent and of variance 1 again."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.residual_tests import Residuals
from tests.diagnosis.fit.small_fit import NOISE, fitter


@pytest.fixture(scope="module")
def residuals(tmp_path_factory: pytest.TempPathFactory) -> Residuals:
    subject = fitter(tmp_path_factory.mktemp("ahead"), {"prnu": {"std": 0.03}})
    noise, fixed = datasheet_noise(subject.model.observation)
    return Residuals.of(subject.fit(noise.with_effect("prnu", {"std": 0.01}, torch.zeros(64, 64)), fixed=fixed), seed=0)


@pytest.mark.parametrize("fitted", [True, False])
def test_variance(residuals: Residuals, fitted: bool) -> None:
    which = residuals.raw[residuals.fit.fitter.split.fitted == fitted]
    assert float(which.square().mean()) == pytest.approx(1, abs=5 * (2 / which.numel()) ** 0.5)


def test_captures_do_not_resemble_each_other(residuals: Residuals) -> None:
    pixel = residuals.raw.sum(0) / len(residuals.raw) ** 0.5
    assert float(pixel.square().mean()) == pytest.approx(1, abs=5 * (2 / pixel.numel()) ** 0.5)


def test_without_a_map_it_is_the_prediction(tmp_path: Path) -> None:
    subject = fitter(tmp_path, {})
    fit = subject.fit(NOISE)
    result = Residuals.of(fit, seed=0).prediction
    assert torch.equal(result.mean, fit.prediction.mean)
    torch.testing.assert_close(result.deviation, fit.prediction.deviation)
