"""Records are read and judged."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from sci_lightning.studies.proving_ground.outcome import Outcome

Record = Callable[..., dict[str, Any]]
GAIN = {"gain": {"factor": 1.1}}
FOUND = {"gain": {"factor": (1.12, 0.01)}}
GHOST = {"ghost": {"fraction": 0.1, "dx": 5.0, "dy": 5.0}}


def outcome(record: dict[str, Any]) -> Outcome:
    parsed = Outcome.model_validate(record)
    assert isinstance(parsed, Outcome)
    return parsed


def test_a_class_of_names_counts_as_any_of_its_members(record: Record) -> None:
    duty = record("single", GAIN, {"duty_cycle": {"fraction": (0.9, 0.01)}})
    assert outcome(duty).wrong_names == ("duty_cycle",)
    for share, right in ((0.4, True), (0.01, False)):
        duty["found"][0] |= {"probability": 0.99, "class": {"duty_cycle": 1 - share, "gain": share}}
        assert outcome(duty).exact == right


def test_exact_sets_of_names(record: Record) -> None:
    assert outcome(record("single", GAIN, FOUND)).exact
    assert not outcome(record("single", GAIN, {})).exact
    assert not outcome(record("single", GAIN, FOUND | {"black_level": {"offset": (0.1, 0.1)}})).exact
    leftover = outcome(record("single", GAIN, FOUND, unnamed=("optics",)))
    assert leftover.exact and not leftover.right


def test_wrong_names(record: Record) -> None:
    """Neither something unnamed beside it, nor the verdict, nor its alternatives excuse a name that is not hidden."""
    assert outcome(record("outside", GHOST, FOUND)).confidently_wrong
    assert not outcome(record("outside", GHOST, {})).confidently_wrong
    assert outcome(record("outside", GHOST, FOUND, unnamed=("optics",))).confidently_wrong
    assert outcome(record("outside", GHOST, FOUND, verdict="partly_explained")).confidently_wrong
    assert not outcome(record("single", GAIN, FOUND)).confidently_wrong
    shift = {"mask_shift": {"dx": (0.1, 0.1), "dy": (0.1, 0.1)}}
    assert outcome(record("fewer", GAIN, shift)).confidently_wrong
    other = outcome(record("fewer", GAIN, shift, alternatives=("gain",)))
    assert other.confidently_wrong and other.hedged
    assert not outcome(record("fewer", GAIN, shift)).hedged


def test_names_that_are_true_of_the_set_up(record: Record) -> None:
    """Pixels that differ anyway, or a noise that the file states wrongly, may be named and need not be."""
    pixels = {"prnu": {"std": (0.005, 0.0001)}}
    rays = {"formulation": "rays", "also_true": ["prnu"], "verdict": "partly_explained"}
    for named in (FOUND, FOUND | pixels):
        seen = outcome(record("single", GAIN, named, unnamed=("exposure",), **rays))
        assert seen.exact and seen.right and not seen.confidently_wrong
    assert not outcome(record("single", GAIN, pixels, **rays)).exact
    assert outcome(record("nothing", {}, pixels, unnamed=("exposure",), **rays)).right
    assert not outcome(record("nothing", {}, FOUND, **rays)).right
    assert outcome(record("nothing", {}, pixels)).confidently_wrong
    hidden = outcome(record("single", {"prnu": {"std": 0.02}}, {}, **rays))
    assert not hidden.exact and hidden.errors == []
    noise = {"read_noise": {"std": (0.8, 0.01)}}
    wrong = {"datasheet": "double", "also_true": ["shot_noise", "read_noise"]}
    assert outcome(record("nothing", {}, noise, **wrong)).right and outcome(record("nothing", {}, {}, **wrong)).right
    assert "datasheet double" in str(outcome(record("nothing", {}, noise, **wrong)))


def test_captures_that_are_left_out(record: Record) -> None:
    """Leaving out exactly the captures that are wrong is as right as naming a stage; any other is wrong."""
    moved = {"moved_capture": {"dx": 2.0, "dy": 1.0, "capture": 7}}
    assert outcome(record("outside", moved, {}, bad_captures=[7])).right
    assert not outcome(record("outside", moved, {}, bad_captures=[6])).right
    assert not outcome(record("outside", moved, {}, bad_captures=[6, 7])).right
    assert not outcome(record("outside", moved, FOUND, bad_captures=[7])).right
    assert not outcome(record("outside", GHOST, {}, unnamed=("optics",), bad_captures=[1])).right
    assert not outcome(record("single", GAIN, FOUND, bad_captures=[1])).right
    assert outcome(record("outside", moved, {}, bad_captures=[7])).answers == ("left out",)


def test_right_needs_the_verdict(record: Record) -> None:
    assert outcome(record("single", GAIN, FOUND)).right
    partly = outcome(record("single", GAIN, FOUND, verdict="partly_explained"))
    assert partly.exact and not partly.right
    assert str(partly).startswith("gain, partly_explained (")
    assert outcome(record("nothing", {}, {})).right
    assert not outcome(record("nothing", {}, {}, verdict="unexplained")).right


def test_the_strongest_stage_counts(record: Record) -> None:
    assert outcome(record("outside", GHOST, {}, unnamed=("optics", "sensor"))).stage_right
    assert not outcome(record("outside", GHOST, {}, unnamed=("sensor", "optics"))).stage_right
    assert not outcome(record("outside", GHOST, {}, unnamed=("sensor",))).stage_right
    assert not outcome(record("outside", GHOST, FOUND)).stage_right
    weighed = record("outside", GHOST, {}, unnamed=("sensor", "optics"))
    for deviation, nats in zip(weighed["unnamed"], (30.0, 500.0), strict=True):
        deviation["nats"] = nats
    assert outcome(weighed).stage_right


def test_errors_in_standard_deviations(record: Record) -> None:
    hidden = {"flicker": {"amplitude": 0.2, "frequency": 1.5, "phase": 3.1}, "pattern_order": {"offset": 2}}
    result = {
        "flicker": {"amplitude": (0.21, 0.01), "frequency": (1.5, 0.0), "phase": (-3.1, 0.1)},
        "pattern_order": {"offset": (2, 0.0)},  # a whole number has no interval
        "gain": {"factor": (1.2, 0.1)},  # not hidden: there is no truth to hold
    }
    errors = dict(outcome(record("pair", hidden, result)).errors)
    assert set(errors) == {"flicker.amplitude", "flicker.frequency", "flicker.phase"}
    assert errors["flicker.amplitude"] == pytest.approx(1)
    assert errors["flicker.phase"] == pytest.approx((2 * math.pi - 6.2) / 0.1)  # once round is nowhere
    assert math.isinf(errors["flicker.frequency"])  # certain of what nobody can be certain of


def test_excess_closed(record: Record) -> None:
    assert outcome(record("single", GAIN, FOUND, before=11, after=1.5)).closed == pytest.approx(0.95)
    assert outcome(record("single", GAIN, FOUND, before=11, after=0.99)).closed == 1


def test_in_words(record: Record) -> None:
    assert str(outcome(record("single", GAIN, FOUND, after=1.01))) == "gain (structural, 8 bits; chi2 10 to 1.01, 5 s)"
    assert str(outcome(record("nothing", {}, FOUND))).startswith("nothing -> gain (")
    assert str(outcome(record("outside", GHOST, {}, unnamed=("optics",)))).startswith("ghost -> unnamed:optics (")


def test_a_record_of_another_format(record: Record) -> None:
    with pytest.raises(ValueError, match="format_version"):
        Outcome.model_validate(record("single", GAIN, FOUND) | {"format_version": 2})
    with pytest.raises(ValueError, match="suite"):
        Outcome.model_validate({"format": "sci-proving-ground-case", "format_version": 1})
