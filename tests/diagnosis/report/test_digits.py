"""Numbers have the digits that mean something, of the noise and of the formulas."""

from __future__ import annotations

import math

import pytest

from sci_lightning.diagnosis.report.sentences import chi2, quantity, uncertainty
from sci_lightning.diagnosis.search.evidence import Estimate
from sci_lightning.diagnosis.search.formula_error import IDEAL, LABORATORY, FormulaError
from sci_lightning.encoder.effects import Gain, MaskOrientation, MaskShift, ShotNoise


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.450037, 0.000083, "0.450037 ± 0.000083"),
        (0.61004, 0.0021, "0.6100 ± 0.0021"),
        (-0.35, 0.12, "-0.35 ± 0.12"),
        (9987.3, 123.4, "9990 ± 120"),
        (0.0, 0.0012, "0.0000 ± 0.0012"),
        (4, 0.0, "4"),
        ("rot90", 0.0, "rot90"),
        (0.5, 0.0, "0.5"),
        (0.5, float("inf"), "0.5"),
        (float("nan"), 0.1, "nan"),
    ],
)
def test_quantity(value: float | str, std: float, text: str) -> None:
    assert quantity(value, std) == text


def test_the_error_of_a_formula_grows_with_what_an_effect_changes() -> None:
    assert IDEAL.of(0.5, Gain.about["factor"]) == pytest.approx(math.hypot(5e-4, 1e-4))
    assert IDEAL.of(0.0, MaskShift.about["dx"]) == pytest.approx(1e-3)
    assert IDEAL.of(1.0, MaskShift.about["dx"]) == IDEAL.of(12.0, MaskShift.about["dx"])
    assert IDEAL.of(9987.3, ShotNoise.about["full_well"]) == pytest.approx(9.9873)
    assert IDEAL.of("rot90", MaskOrientation.about["operation"]) == 0
    assert LABORATORY.of(-0.35, MaskShift.about["dx"]) == pytest.approx(math.hypot(7e-3, 1e-2))


def test_an_estimate_has_the_errors_of_pixels_and_of_the_formula() -> None:
    estimate = Estimate.of(0.0, MaskShift.about["dx"], 0.003, FormulaError(0.0, 0.04))
    assert (estimate.std, estimate.systematic) == (pytest.approx(0.005), pytest.approx(0.004))


def test_uncertainty() -> None:
    assert [uncertainty(std) for std in (0.000083, 0.0121, 123.4, 0.0)] == ["0.000083", "0.012", "120", ""]


def test_chi2() -> None:
    assert [chi2(value) for value in (0.9812, 33.219, 168.93, 12345.6)] == ["0.981", "33.22", "168.9", "12346"]
