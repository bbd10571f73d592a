"""Judging a record."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from sci_lightning.proving_ground.outcome import Outcome

GAIN = {"gain": {"factor": 1.1}}
FOUND = {"gain": {"factor": (1.12, 0.01)}}
GHOST = {"ghost": {"fraction": 0.1, "dx": 5.0, "dy": 5.0}}


def test_exact_sets_of_names(record: Callable[..., Any]) -> None:
    assert Outcome(record("single", GAIN, FOUND)).exact
    assert not Outcome(record("single", GAIN, {})).exact
    assert not Outcome(record("single", GAIN, FOUND | {"black_level": {"offset": (0.1, 0.1)}})).exact
    leftover = Outcome(record("single", GAIN, FOUND, unnamed=("optics",)))
    assert leftover.exact and not leftover.right


def test_confident_wrong_names(record: Callable[..., Any]) -> None:
    assert Outcome(record("outside", GHOST, FOUND)).confidently_wrong
    assert not Outcome(record("outside", GHOST, {})).confidently_wrong
    assert not Outcome(record("outside", GHOST, FOUND, unnamed=("optics",))).confidently_wrong
    assert not Outcome(record("outside", GHOST, FOUND, verdict="partly_explained")).confidently_wrong
    assert not Outcome(record("single", GAIN, FOUND)).confidently_wrong
    shift = {"mask_shift": {"dx": (0.1, 0.1), "dy": (0.1, 0.1)}}
    assert Outcome(record("fewer", GAIN, shift)).confidently_wrong
    assert not Outcome(record("fewer", GAIN, shift, alternatives=("gain",))).confidently_wrong


def test_stage(record: Callable[..., Any]) -> None:
    assert Outcome(record("outside", GHOST, {}, unnamed=("sensor", "optics"))).stage_right
    assert not Outcome(record("outside", GHOST, {}, unnamed=("sensor",))).stage_right
    assert not Outcome(record("outside", GHOST, FOUND)).stage_right


def test_errors_in_standard_deviations(record: Callable[..., Any]) -> None:
    hidden = {"flicker": {"amplitude": 0.2, "frequency": 1.5, "phase": 3.1}, "pattern_order": {"offset": 2}}
    found = {
        "flicker": {"amplitude": (0.21, 0.01), "frequency": (1.5, 0.0), "phase": (-3.1, 0.1)},
        "pattern_order": {"offset": (2, 0.0)},  # a whole number has no interval
        "gain": {"factor": (1.2, 0.1)},  # not hidden: there is no truth to hold
    }
    errors = dict(Outcome(record("pair", hidden, found)).errors)
    assert set(errors) == {"flicker.amplitude", "flicker.frequency", "flicker.phase"}
    assert errors["flicker.amplitude"] == pytest.approx(1)
    assert errors["flicker.phase"] == pytest.approx((2 * math.pi - 6.2) / 0.1)  # once round is nowhere
    assert math.isinf(errors["flicker.frequency"])  # certain of what nobody can be certain of


def test_excess_closed(record: Callable[..., Any]) -> None:
    assert Outcome(record("single", GAIN, FOUND, before=11, after=1.5)).closed == pytest.approx(0.95)
    assert Outcome(record("single", GAIN, FOUND, before=11, after=0.99)).closed == 1


def test_in_words(record: Callable[..., Any]) -> None:
    assert str(Outcome(record("single", GAIN, FOUND, after=1.01))) == "gain (structural, 8 bits; chi2 10 to 1.01, 5 s)"
    assert str(Outcome(record("nothing", {}, FOUND))).startswith("nothing -> gain (")
    assert str(Outcome(record("outside", GHOST, {}, unnamed=("optics",)))).startswith("ghost -> unnamed:optics (")
