"""Verdicts in one sentence."""

from __future__ import annotations

from typing import Any

from sci_lightning.diagnosis.report.sentences import headline, say
from tests.diagnosis.residual_tests.test_residual_test import with_p

SHIFT = {
    "name": "mask_shift",
    "parameters": {
        "dx": {"value": 0.61, "std": 0.0021, "systematic": 6.1e-4, "unit": "pixel"},
        "dy": {"value": -0.35, "std": 0.0019, "systematic": 3.5e-4, "unit": "pixel"},
    },
}
GHOST = {"stage": "optics", "where": "a second image lies beside the first"}


def report(effects: list[Any], unnamed: list[Any], **gaps: dict[str, float]) -> dict[str, Any]:
    shared = {"pixels": 20000, "chi2_limit": 1.05}
    found = {
        "before": {"chi2": 168.93, "rmse_dn": 19.1, "nll": 80.0, **shared, **gaps.get("before", {})},
        "after": {"chi2": 0.981, "rmse_dn": 1.54, "nll": 1.7, **shared, **gaps.get("after", {})},
    }
    clean = not unnamed and found["after"]["chi2"] <= 1.05
    verdict = ("explained" if effects else "consistent") if clean else "partly_explained" if effects else "unexplained"
    return {"verdict": verdict, "effects": effects, "unnamed": unnamed, "gap": found}


def test_explained() -> None:
    assert headline(report([SHIFT], []), []) == (
        "The mask's image is displaced by (0.610 ± 0.002, -0.350 ± 0.002) pixel; with that in the model the held-out "
        "RMS error falls from 19.1 to 1.54 DN (chi2 168.9 to 0.981), and nothing significant is left."
    )


def test_it_leads_with_what_fell() -> None:
    """A chi2 that rises is no improvement that anybody sees; below 1 it says that the noise was overestimated."""
    before, after = {"chi2": 0.498, "rmse_dn": 5.2}, {"chi2": 1.008, "rmse_dn": 1.0}
    assert (
        "the held-out RMS error falls from 5.2 to 1 DN (from chi2 0.498, below 1 because the noise was overestimated, "
        "to 1.008), and"
    ) in headline(report([SHIFT], [], before=before, after=after), [])
    noise = {"rmse_dn": 1.54, "chi2": 2.5}
    assert "the held-out misfit falls from chi2 2.500 to 0.981, and" in headline(report([SHIFT], [], before=noise), [])
    weak = {"rmse_dn": 1.541, "chi2": 0.982, "nll": 1.7003}
    likelier = "held-out pixels become likelier by 6 nats (chi2 0.981), and"
    assert likelier in headline(report([SHIFT], [], before=weak), [])
    less = {"rmse_dn": 1.54, "chi2": 0.4, "nll": 1.8}
    assert "likelier by 2,000 nats (from chi2 0.400, below 1" in headline(report([SHIFT], [], before=less), [])


def test_an_alternative_is_admitted() -> None:
    sentence = headline(report([SHIFT | {"alternatives": ["mask_scale", "mine"]}], []), [])
    assert "pixel (or it is mask_scale or mine, which these captures cannot tell from it); with" in sentence
    many = [{**SHIFT, "name": name, "alternatives": ["x"]} for name in ("a", "b", "c", "d")]
    assert headline(report(many, []), []).startswith("4 effects act together: a (or x), b (or x), c (or x), d (or x); ")


def test_nothing_hidden() -> None:
    assert headline(report([], []), []) == (
        "The captures agree with the ideal camera: held-out chi2 0.981, and nothing significant is left."
    )


def test_something_is_left() -> None:
    rows = report([SHIFT], []) | {"verdict": "partly_explained"}
    assert "but the residuals are not noise yet (rows)" in headline(rows, [with_p(1e-9)])
    assert "but something without a name is left (in the optics, a second" in headline(report([SHIFT], [GHOST]), [])
    unexplained = headline(report([], [GHOST], after={"chi2": 168.93}), [])
    assert "(held-out chi2 168.9) and no name explains it: in the optics" in unexplained


def test_many_effects_are_listed_by_name() -> None:
    effects = [{**SHIFT, "name": name} for name in ("a", "b", "c", "d")]
    assert headline(report(effects, []), []).startswith("4 effects act together: a, b, c, d; ")


def test_an_effect_of_a_user() -> None:
    loss = {"value": 0.2, "std": 0.01, "systematic": 2e-4, "unit": "1"}
    assert say({"name": "scratch", "parameters": {"loss": loss}}) == "scratch (loss 0.200 ± 0.010)"
