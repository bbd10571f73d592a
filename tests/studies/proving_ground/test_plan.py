"""Which cases are tried."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import replace
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.studies.proving_ground.plan import SUITES, in_turns, plan
from sci_lightning.virtual_camera import DRAWN, EFFECTS, LATER, OUTSIDE

SINCE = (
    "illumination",
    "mask_distortion",
    "mask_keystone",
    "duty_cycle",
    *(name for name in DRAWN if name.startswith("scene_")),
)
"""Effects that could not be hidden in the first records."""
FORMER = [name for name in DRAWN if name not in SINCE]


def by_suite(cases: list[Case], suite: str) -> list[Case]:
    return [case for case in cases if case.suite == suite]


def test_every_effect_has_its_turn() -> None:
    cases = plan(seeds=2)
    assert {case.effects for case in by_suite(cases, "single")} == {(name,) for name in DRAWN}
    assert {case.effects for case in by_suite(cases, "outside")} == {(name,) for name in OUTSIDE}
    assert {case.effects for case in by_suite(cases, "later")} == {(name,) for name in LATER}
    assert {name for case in by_suite(cases, "weak") for name in case.effects} == set(DRAWN) - {
        "pattern_order",
        "mask_orientation",
        "bit_depth",
    }
    for suite, many in (("pair", 2), ("triple", 3)):
        assert {len(set(case.effects)) for case in by_suite(cases, suite)} == {many}
        assert max(Counter(name for case in by_suite(cases, suite) for name in case.effects).values()) <= 2
    assert all(list(case.effects) == sorted(case.effects, key=list(EFFECTS).index) for case in cases)
    assert {case.captures for case in by_suite(cases, "fewer")} == {"no_dark", "no_pattern", "moving"}


def test_cases_are_told_apart_and_come_again() -> None:
    cases = plan(seeds=3)
    for attribute in ("name", "seed", "digest"):
        assert len({getattr(case, attribute) for case in cases}) == len(cases), attribute
    assert cases == plan(seeds=3)
    assert set(plan(seeds=2)) < set(cases)
    assert {case.digest for case in plan(size=(65, 64))}.isdisjoint(case.digest for case in cases)


def in_a_dark_world(case: Case) -> Case:
    """The case with a camera for which nothing goes on beyond the field, as all were then."""
    return replace(case, session=replace(case.session, surround="dark"))


def test_further_rounds_are_those_of_a_longer_run() -> None:
    longer = plan(["single", "nothing"], seeds=3)
    further = plan(["single", "nothing"], seeds=2, first_round=1)
    assert set(further) < set(longer) and len(further) == 2 * len(longer) // 3


def test_cases_are_those_of_earlier_records() -> None:
    """A record is taken for that of a case by the digest of its settings, and captures follow from the seed."""
    cases = [in_a_dark_world(case) for case in plan(["pair", "nothing"], seeds=2, cases=2, effects=FORMER)]
    assert [(case.digest, case.seed) for case in cases[2:5]] == [
        ("55865b125be9e9fa", 3943646687),
        ("8836ae9847cfee3c", 3523630466),
        ("30505dd565df194f", 1427802300),
    ]
    suites = [suite for suite in SUITES if suite not in ("outside", "later", "faint")]  # they have changed, or are new
    digests = "".join(in_a_dark_world(case).digest for case in plan(suites, seeds=2, effects=FORMER))
    assert hashlib.sha256(digests.encode()).hexdigest().startswith("fd0382a2f7412ee9")


def test_a_run_that_is_stopped_has_tried_every_suite() -> None:
    cases = plan(seeds=2)
    turns = in_turns(cases)
    assert sorted(case.name for case in turns) == sorted(case.name for case in cases)
    for suite in SUITES:
        in_first_half = len(by_suite(turns[: len(turns) // 2], suite))
        assert abs(in_first_half - len(by_suite(cases, suite)) / 2) <= 1, suite
        assert by_suite(turns, suite) == by_suite(cases, suite)


def test_masks_and_bit_depths_take_turns() -> None:
    for cases in (by_suite(plan(), "nothing"), by_suite(plan(cases=6, effects=FORMER), "single")):
        count = Counter((case.session.mask, case.session.bit_depth) for case in cases)
        assert len(count) == 6 and max(count.values()) - min(count.values()) <= 1


def test_effects_suit_their_camera() -> None:
    (case,) = plan(["single"], effects=["mask_level_gamma"], masks=["structural", "binary"])
    assert case.session.mask == "structural"
    assert plan(["single"], effects=["mask_level_gamma"], masks=["binary"]) == []


def test_captures_left_out() -> None:
    counts = {case.captures: case.session.counts for case in by_suite(plan(), "fewer")}
    assert counts["no_dark"]["dark"] == 0 and counts["no_dark"]["pattern"] == 8
    assert counts["no_pattern"]["pattern"] == 0 and counts["no_pattern"]["dark"] == 4
    assert {kind for kind, count in counts["moving"].items() if count} == {"dynamic"}


def test_the_command_makes_the_same_camera() -> None:
    (case,) = plan(["weak"], effects=["gain"], bit_depths=[12], masks=["binary"], size=(40, 64))
    words = case.command.split()
    assert {"'effects=[gain]'", f"seed={case.seed}", "magnitude=weak", "mask=binary", "bit_depth=12"} <= set(words)
    assert "'size=[40,64]'" in words and not any(word.startswith(("frames=", "formulation=")) for word in words)
    (case,) = plan(["single"], effects=["gain"], bit_depths=[8], masks=["binary"], datasheets=["half"], slots=[16])
    assert {"datasheet_factor=0.5", "frames=16"} <= set(case.command.split())


def test_many_cameras_take_turns() -> None:
    """The run of several hundred cases: all suites, and all cameras in about equal numbers."""
    cases = plan(seeds=4, slots=(4, 8, 16), bit_depths=range(8, 13), datasheets=("stated", "silent", "double", "half"))
    assert len(cases) >= 600 and {case.suite for case in cases} == set(SUITES)
    for suite in SUITES:
        some = by_suite(cases, suite)
        for number, setting in ((3, "frames"), (5, "bit_depth"), (2, "mask")):
            count = Counter(getattr(case.session, setting) for case in some)
            assert len(count) == number and min(count.values()) > 0.5 * len(some) / number, (suite, setting, count)
        assert {case.datasheet for case in some} == {"stated", "silent", "double", "half"}
    assert all(not {"shot_noise", "read_noise"} & set(case.effects) for case in cases if case.datasheet != "stated")
    for attribute in ("name", "seed", "digest"):
        assert len({getattr(case, attribute) for case in cases}) == len(cases), attribute


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"suites": ["singles"]}, "no 'singles'; choose of " + ", ".join(SUITES)),
        ({"effects": ["mask_shft"]}, "no 'mask_shft'"),
        ({"seeds": 0}, "seeds must be a whole number of 1 or more"),
        ({"cases": 0}, "cases must be a whole number of 1 or more"),
        ({"suites": []}, "suites must have at least one entry"),
        ({"effects": []}, "effects must have at least one entry"),
        ({"masks": []}, "masks must have at least one entry"),
        ({"slots": []}, "slots must have at least one entry"),
        ({"datasheets": ["wrong"]}, "datasheets: no 'wrong'; choose of stated, silent, double, half"),
        ({"formulations": ["waves"]}, "formulation must be overlap or rays"),
        ({"masks": ["solid"]}, "no such file"),
        ({"size": [8, 8]}, "size must be a whole number from 16"),
    ],
)
def test_wrong_plans(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        plan(**wrong)
