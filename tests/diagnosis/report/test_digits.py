"""Numbers have the digits that mean something, of the noise and of the formulas."""

from __future__ import annotations

import pytest

from sci_lightning.diagnosis.report.sentences import chi2, quantity, uncertainty
from sci_lightning.diagnosis.search.evidence import systematic_limit
from sci_lightning.encoder.effects import Gain, MaskOrientation, MaskShift, ShotNoise


@pytest.mark.parametrize(
    ("value", "std", "systematic", "text"),
    [
        (0.450037, 0.000083, 0.00045, "0.450"),
        (0.61004, 0.0021, 0.0, "0.6100 ± 0.0021"),
        (0.61004, 0.0021, 0.00061, "0.610 ± 0.002"),
        (0.0031, 0.0012, 3.1e-6, "0.0031 ± 0.0012"),
        (-0.35, 0.12, 0.00035, "-0.35 ± 0.12"),
        (9987.3, 123.4, 9.99, "9990 ± 120"),
        (0.900087, 0.000085, 1e-4, "0.9001 ± 0.0001"),
        (0.0, 0.0012, 0.0, "0.0000 ± 0.0012"),
        (4, 0.0, 0.0, "4"),
        ("rot90", 0.0, 0.0, "rot90"),
        (0.5, 0.0, 0.0, "0.5"),
        (0.5, float("inf"), 0.0, "0.5"),
        (float("nan"), 0.1, 0.1, "nan"),
    ],
)
def test_quantity(value: float | str, std: float, systematic: float, text: str) -> None:
    assert quantity(value, std, systematic) == text


def test_the_systematic_limit_is_a_part_of_what_an_effect_changes() -> None:
    assert systematic_limit(0.9, Gain.about["factor"]) == pytest.approx(1e-4)
    assert systematic_limit(-0.35, MaskShift.about["dx"]) == pytest.approx(3.5e-4)
    assert systematic_limit(9987.3, ShotNoise.about["full_well"]) == pytest.approx(9.9873)
    assert systematic_limit("rot90", MaskOrientation.about["operation"]) == 0


def test_uncertainty() -> None:
    assert [uncertainty(std) for std in (0.000083, 0.0121, 123.4, 0.0)] == ["0.000083", "0.012", "120", ""]


def test_chi2() -> None:
    assert [chi2(value) for value in (0.9812, 33.219, 168.93, 12345.6)] == ["0.981", "33.22", "168.9", "12346"]
