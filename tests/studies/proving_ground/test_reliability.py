"""Stated probabilities beside how often they are right."""

from __future__ import annotations

import pytest

from sci_lightning.files.diagnosis_report import NamedEffect
from sci_lightning.studies.proving_ground.reliability import Statement, reliability, statements


def named(name: str, probability: float | None, shares: dict[str, float]) -> NamedEffect:
    content = {"name": name, "stage": "sensor", "parameters": {}, "evidence": {}, "alternatives": [], "tell_apart": ""}
    return NamedEffect.model_validate({**content, "probability": probability, "class": shares})


def test_a_class_is_stated_and_each_of_its_members() -> None:
    effects = [named("gain", 0.9, {"gain": 0.6, "duty_cycle": 0.4}), named("read_noise", None, {})]
    stated = statements(effects, {"mask_blur": 0.3}, {"duty_cycle"})
    assert stated == [
        Statement(0.3, False),
        Statement(0.9, True),
        Statement(pytest.approx(0.54), False),
        Statement(pytest.approx(0.36), True),
    ]


def test_probabilities_that_are_near_each_other_are_counted_together() -> None:
    rows = reliability([Statement(0.2, True), Statement(0.25, False), Statement(1.0, True), Statement(0.001, False)])
    assert [(row.low, row.true.count, row.true.total) for row in rows] == [(0.1, 1, 2), (0.999, 1, 1)]
    assert rows[0].stated == pytest.approx(0.225)
