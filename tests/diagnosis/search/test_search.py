"""The search names what the virtual camera hides, and nothing where nothing is hidden."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.diagnosis.search.selection import select_effects
from tests.diagnosis.fit.small_fit import NOISE, fitter


@pytest.mark.parametrize(
    "hidden",
    [
        {},
        {"pattern_order": {"offset": 2}},
        pytest.param({"flicker": {"amplitude": 0.1, "frequency": 1.3, "phase": 0.4}}, marks=pytest.mark.slow),
        pytest.param({"vignetting": {"strength": 0.2}, "gain": {"factor": 0.93}}, marks=pytest.mark.slow),
    ],
)
def test_names(tmp_path: Path, hidden: dict[str, dict[str, float]]) -> None:
    result, _, _ = select_effects(fitter(tmp_path, hidden), NOISE)
    assert set(result.hypothesis.effects) - set(NOISE.effects) == set(hidden)
