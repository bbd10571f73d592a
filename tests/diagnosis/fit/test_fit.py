"""Joint fits recover what the virtual camera hides, given its name."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.diagnosis.fit.small_fit import NOISE, fitter


def errors(fit: Fit) -> dict[tuple[str, str], float]:
    deviations = torch.linalg.inv(fit.information).diagonal().sqrt()
    return dict(zip(fit.free, deviations.tolist(), strict=True))


@pytest.mark.parametrize(
    ("name", "start", "truth"),
    [
        ("mask_shift", {"dx": 0.4, "dy": -0.4}, {"dx": 0.61, "dy": -0.35}),
        ("gain", {"factor": 1.0}, {"factor": 0.93}),
        ("mask_blur", {"sigma": 0.3}, {"sigma": 0.52}),
        ("black_level", {"offset": 0.0}, {"offset": 0.013}),
    ],
)
def test_parameters(tmp_path: Path, name: str, start: dict[str, float], truth: dict[str, float]) -> None:
    subject = fitter(tmp_path, {name: truth}).covering(NOISE.with_effect(name, dict(truth)))
    without = subject.fit(NOISE)
    result = subject.fit(NOISE.with_effect(name, dict(start)))
    assert result.held_out_log_likelihood > without.held_out_log_likelihood + 100
    deviation = errors(result)
    for parameter, value in truth.items():
        error = float(result.hypothesis.effects[name][parameter]) - value
        assert abs(error) < 5 * deviation[name, parameter] < 0.02


def test_an_angle_is_reported_within_half_a_turn(tmp_path: Path) -> None:
    truth = {"amplitude": 0.1, "frequency": 1.3, "phase": -2.9}
    subject = fitter(tmp_path, {"flicker": truth})
    result = subject.fit(NOISE.with_effect("flicker", {**truth, "phase": 2.9}))
    assert abs(float(result.hypothesis.effects["flicker"]["phase"]) + 2.9) < 0.02


def test_map(tmp_path: Path) -> None:
    subject = fitter(tmp_path, {"prnu": {"std": 0.03}})
    result = subject.fit(NOISE.with_effect("prnu", {"std": 0.01}, torch.zeros(64, 64)))
    estimated = result.maps["prnu"]
    assert abs(estimated.std - 0.03) < 5 * estimated.std_error < 0.005
    assert result.held_out_log_likelihood > subject.fit(NOISE).held_out_log_likelihood + 100


def test_a_gain_beside_a_map_that_scales_with_it(tmp_path: Path) -> None:
    """Were the maps' uncertainty not to count as it changes with the gain, this one would be 1 + 0.06**2 too large."""
    subject = fitter(tmp_path, {"prnu": {"std": 0.06}, "gain": {"factor": 0.9}})
    start = NOISE.with_effect("gain", {"factor": 0.9}).with_effect("prnu", {"std": 0.06}, torch.zeros(64, 64))
    result = subject.fit(start, iterations=20)
    error = float(result.hypothesis.effects["gain"]["factor"]) - 0.9
    assert abs(error) < 2 * errors(result)["gain", "factor"] < 0.9 * 0.06**2


def test_the_order_of_the_captures_does_not_matter(tmp_path: Path) -> None:
    VirtualCamera(Session(size=(32, 32))).write(tmp_path / "a.h5", seed=1)
    captures = read_captures(tmp_path / "a.h5")
    one, other = observe(captures), observe(captures.take(list(range(len(captures)))[::-1]))
    assert torch.equal(one.dn, other.dn)
    assert torch.equal(split(one).fitted, split(other).fitted)


def test_captures_of_one_pixel() -> None:
    observation: Any = SimpleNamespace(kinds=("flat",), size=(1, 1), number=torch.zeros(1))
    with pytest.raises(BadInput, match="1 x 1 pixels"):
        split(observation)
