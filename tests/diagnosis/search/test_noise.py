"""Noise differs from the datasheet's where even captures say so too, and not where only textures do."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.search.noise import select_noise
from tests.diagnosis.fit.small_fit import fitter


@pytest.mark.parametrize(
    ("hidden", "names"),
    [
        ({}, []),
        ({"shot_noise": {"full_well": 4000.0}}, ["shot_noise"]),
        ({"read_noise": {"std": 3.0}}, ["read_noise"]),
        ({"bit_planes": {"order": "msb_first"}}, []),
    ],
)
def test_noise_is_measured_on_even_captures(
    tmp_path: Path, hidden: dict[str, dict[str, float]], names: list[str]
) -> None:
    """Whatever the model lacks in textures would be taken for noise there, by thousands of nats."""
    subject = fitter(tmp_path, hidden)
    nominal, stated = datasheet_noise(subject.model.observation)
    settled, probabilities = select_noise(subject.fit(nominal, iterations=30))
    assert list(probabilities) == names
    for name, probability in probabilities.items():
        ((parameter, value),) = hidden[name].items()
        assert probability > 0.95 and settled.hypothesis.effects[name][parameter] == pytest.approx(value, rel=0.05)
    for name, parameter in stated:
        if name not in names:
            assert settled.hypothesis.effects[name][parameter] == nominal.effects[name][parameter]
