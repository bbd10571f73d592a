"""Noise differs from the datasheet's where even captures say so too, and not where only textures do."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.search.noise import MAX_TIMES_DATASHEET, beyond_datasheet, select_noise
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


@pytest.mark.parametrize(("name", "parameter", "exponent"), [("read_noise", "std", 1), ("shot_noise", "full_well", -2)])
def test_what_is_much_noisier_is_no_noise(tmp_path: Path, name: str, parameter: str, exponent: int) -> None:
    """It is a misfit of the model, which more noise would hide."""
    subject = fitter(tmp_path, {})
    nominal, _ = datasheet_noise(subject.model.observation)
    for times in (0.1, 0.9 * MAX_TIMES_DATASHEET, 1.1 * MAX_TIMES_DATASHEET):
        value = float(nominal.effects[name][parameter]) * times**exponent
        fit = subject.fit(nominal.with_effect(name, {parameter: value}), fixed=((name, parameter),))
        assert beyond_datasheet(fit) == beyond_datasheet(fit, (name, parameter)) == (times > MAX_TIMES_DATASHEET)
