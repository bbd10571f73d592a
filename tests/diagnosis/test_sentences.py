"""Verdicts in one sentence, numbers with the digits that mean something."""

from __future__ import annotations

from string import Formatter
from typing import Any

import pytest

from sci_lightning.diagnosis.sentences import EFFECTS, chi2, headline, quantity, say
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis.residual_tests.test_residual_test import with_p

SHIFT = {
    "name": "mask_shift",
    "parameters": {
        "dx": {"value": 0.61, "std": 0.0021, "unit": "pixel"},
        "dy": {"value": -0.35, "std": 0.0019, "unit": "pixel"},
    },
}
GHOST = {"stage": "optics", "where": "a second image lies beside the first"}


def report(effects: list[Any], unnamed: list[Any]) -> dict[str, Any]:
    return {"effects": effects, "unnamed": unnamed, "gap": {"before": {"chi2": 168.93}, "after": {"chi2": 0.981}}}


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.61004, 0.0021, "0.6100 ± 0.0021"),
        (-0.35, 0.12, "-0.35 ± 0.12"),
        (9987.3, 123.4, "9987 ± 123"),
        (4, 0.0, "4"),
        ("rot90", 0.0, "rot90"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_quantity(value: float | str, std: float, text: str) -> None:
    assert quantity(value, std) == text


def test_chi2() -> None:
    assert [chi2(value) for value in (0.9812, 33.219, 168.93, 12345.6)] == ["0.981", "33.22", "168.9", "12346"]


def test_explained() -> None:
    assert headline(report([SHIFT], []), []) == (
        "The mask's image is displaced by (0.6100 ± 0.0021, -0.3500 ± 0.0019) pixel; with that in the model the "
        "held-out misfit falls from chi2 168.9 to 0.981, and nothing significant is left."
    )


def test_nothing_hidden() -> None:
    assert headline(report([], []), []) == (
        "The captures agree with the ideal camera: held-out chi2 0.981, and nothing significant is left."
    )


def test_something_is_left() -> None:
    assert "but the residuals are not noise yet (rows)" in headline(report([SHIFT], []), [with_p(1e-9)])
    assert "but something without a name is left (in the optics, a second" in headline(report([SHIFT], [GHOST]), [])
    assert "(held-out chi2 168.9) and no name explains it: in the optics" in headline(report([], [GHOST]), [])


def test_many_effects_are_listed_by_name() -> None:
    effects = [{**SHIFT, "name": name} for name in ("a", "b", "c", "d")]
    assert headline(report(effects, []), []).startswith("4 effects act together: a, b, c, d; ")


def test_an_effect_of_a_user() -> None:
    loss = {"value": 0.2, "std": 0.01, "unit": "1"}
    assert say({"name": "scratch", "parameters": {"loss": loss}}) == "scratch (loss 0.200 ± 0.010)"


def test_every_effect_of_the_package_has_words_for_all_its_parameters() -> None:
    parameters = {
        name: {field for _, field, _, _ in Formatter().parse(text) if field} for name, text in EFFECTS.items()
    }
    told = {name: set(effect.about) for name, effect in vocabulary().items()}
    told["flicker"].remove("phase")  # says nothing to people
    assert parameters == told
