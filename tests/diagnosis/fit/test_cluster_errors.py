"""Errors by clusters are those of the model where the model is right, and larger where a laboratory is imperfect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from sci_lightning.diagnosis.fit.cluster_errors import cluster_errors, dispersion
from sci_lightning.diagnosis.fit.fit import Fitter
from tests.diagnosis.fit.small_fit import NOISE, fitter

GAIN = ("gain", "factor")


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_exposures_that_jitter(tmp_path: Path, jitter: float) -> None:
    """A gain is known to the pixels' noise from so many pixels, and to a part of the jitter from so few captures."""
    subject = fitter(tmp_path, {"gain": {"factor": 0.93}})
    observation = subject.model.observation
    factors = 1 + jitter * torch.randn(len(observation), generator=torch.Generator().manual_seed(0))
    jittered = replace(observation, dn=(observation.dn * factors[:, None, None]).round())
    subject = Fitter(subject.model.of_captures(jittered), subject.split)
    fit = subject.fit(NOISE.with_effect("gain", {"factor": 0.9}))
    errors = cluster_errors(fit)
    inflated = errors.of_effect("gain")[0] ** 0.5
    assert inflated > 5 if jitter else 1 <= inflated < 1.7
    error = float(fit.hypothesis.effects["gain"]["factor"]) - 0.93
    assert abs(error) < 3 * errors.deviation(GAIN) < 0.02
    assert errors.deviation(("gain", "offset")) == 0


@pytest.mark.parametrize(("squares", "free", "expected"), [(11, 11, 1), (1100, 11, 120), (33, 33, 1)])
def test_dispersion(squares: float, free: int, expected: float) -> None:
    """As many squares as degrees of freedom are noise; a hundred times as many are a hundredfold variance."""
    factor, wrong = dispersion(squares, free)
    assert factor == pytest.approx(expected, rel=0.15) and factor >= 1
    assert wrong > 0.99 if squares > 10 * free else wrong < 0.6
