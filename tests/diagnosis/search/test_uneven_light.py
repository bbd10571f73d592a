"""Smooth unevenness of the light is named illumination, beside vignetting and PRNU and told apart from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.report.corrected_camera import write_encoder
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check

NAMES = ("illumination", "vignetting", "prnu", "gain", "veiling_glare", "column_noise", "shot_noise", "read_noise")
FEW = {name: vocabulary()[name] for name in NAMES}
SESSION = Session(size=(40, 48), frames=4, surround="dark")


def found_in(hidden: dict[str, Any], seed: int = 2) -> tuple[Diagnosis, dict[str, np.ndarray]]:
    simulation = VirtualCamera(SESSION, hidden).simulate(seed)
    return diagnose(simulation.captures(), FEW), simulation.fixed_maps


def test_the_map_and_its_strength_are_estimated(tmp_path: Path) -> None:
    result, maps = found_in({"illumination": {"std": 0.05}})
    assert result.names == ("illumination",) and result.verdict == "explained"
    std = result.effects[0].parameters["std"]
    assert abs(float(std.value) - 0.05) < 4 * std.std < 0.004
    estimated = result.after.fit.hypothesis.maps["illumination"].numpy()
    assert np.abs(estimated - (maps["illumination"] - 1)).max() < 0.01
    check("report", describe(result))
    write_encoder(result, tmp_path)
    effect = yaml.safe_load((tmp_path / "encoder.yaml").read_text())["effects"]["illumination"]
    written = effect["std"] * np.load(tmp_path / effect["file"])
    np.testing.assert_allclose(written, estimated, atol=1e-6)


@pytest.mark.parametrize(
    "hidden",
    [
        {"vignetting": {"strength": 0.2}},
        pytest.param({"prnu": {"std": 0.02}}, marks=pytest.mark.slow),
        pytest.param({"prnu": {"std": 0.02}, "illumination": {"std": 0.04}}, marks=pytest.mark.slow),
        pytest.param({"veiling_glare": {"fraction": 0.08}, "illumination": {"std": 0.04}}, marks=pytest.mark.slow),
    ],
)
def test_told_apart(hidden: dict[str, dict[str, float]]) -> None:
    result, _ = found_in(hidden)
    assert set(result.names) == set(hidden) and result.verdict == "explained"
    for effect in result.effects:
        for name, estimate in effect.parameters.items():
            assert abs(float(estimate.value) - hidden[effect.name][name]) < 4 * estimate.std


@pytest.mark.slow
def test_the_size_of_the_field_may_be_anything() -> None:
    captures = VirtualCamera(replace(SESSION, size=(16, 16)), {"illumination": {"std": 0.1}}).capture(1)
    rows = replace(
        captures,
        patterns=captures.patterns[:, :4],
        measurement=captures.measurement[:, :4],
        scene=captures.scene[:, :, :4],
    )
    for one in (captures, rows):
        assert "illumination" in diagnose(one, FEW).names
