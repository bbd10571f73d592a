"""Effects told exactly, by name, or left to the seed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import DRAWN, OUTSIDE, Session, VirtualCamera, choose_effects

SESSION = Session(size=(24, 24), frames=4)


@pytest.mark.parametrize("nothing", [None, "none", [], {}])
def test_nothing(nothing):
    assert choose_effects(nothing, SESSION, 0) == {}


def test_told() -> None:
    told = {"dx": 0.61, "dy": -0.35}
    for wish in ({"mask_shift": told}, [{"name": "mask_shift", **told}]):
        assert choose_effects(wish, SESSION, 0)["mask_shift"].values == told
    assert choose_effects({"mask_shift": {"dx": 1}}, SESSION, 0)["mask_shift"].values == {"dx": 1.0, "dy": 0.0}


def test_by_name_and_seed() -> None:
    drawn = {seed: choose_effects(["mask_shift", "gain"], SESSION, seed) for seed in (1, 2)}
    assert list(drawn[1]) == ["mask_shift", "gain"] and drawn[1] != drawn[2]
    assert (
        choose_effects("gain", SESSION, 1)["gain"]
        == choose_effects({"gain": None}, SESSION, 1)["gain"]
        == drawn[1]["gain"]
    )
    offset = drawn[1]["mask_shift"].values["dx"] * 64
    assert offset != round(offset)


def test_at_random() -> None:
    names = [tuple(choose_effects("random", SESSION, seed, number=2)) for seed in range(60)]
    assert all(len(set(pair)) == 2 and set(pair) <= set(DRAWN) for pair in names)
    assert len({name for pair in names for name in pair}) == len(DRAWN)
    assert {name for seed in range(200) for name in choose_effects("outside", SESSION, seed)} == set(OUTSIDE)


def test_random_effects_can_show() -> None:
    session = replace(SESSION, size=(24, 30), mask="binary", datasheet=False)
    everything = choose_effects("random", session, 0, number=len(DRAWN) - 3)
    assert set(DRAWN) - set(everything) == {"mask_level_gamma", "shot_noise", "read_noise"}
    for seed in range(10):
        operation = choose_effects("mask_orientation", session, seed)["mask_orientation"].values["operation"]
        assert operation in ("flip_lr", "flip_ud", "rot180")


@pytest.mark.parametrize(
    "name",
    [
        *("mask_shift", "prnu", "flicker"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("optical_blur", "saturation", "shot_noise", "ghost")),
    ],
)
def test_weak_effects_gain_30_to_100_nats(name: str) -> None:
    assert VirtualCamera(SESSION, name).simulate(4).truth().log_likelihood_gain > 1000
    gain = VirtualCamera(SESSION, name, magnitude="weak").simulate(4).truth().log_likelihood_gain
    assert (30 <= gain <= 100) if name != "prnu" else gain > 100  # of a map, most must be learned
    if name == "mask_shift":
        assert 3 <= VirtualCamera(SESSION, name, magnitude="faint").simulate(4).truth().log_likelihood_gain <= 30


def test_weak_leaves_what_has_no_magnitude() -> None:
    assert choose_effects("pattern_order", SESSION, 1, magnitude="weak") == choose_effects("pattern_order", SESSION, 1)


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ("mask_shft", "no effect 'mask_shft'; choose random, outside, none or of .*mask_shift"),
        (["gain", "gain"], "named twice"),
        ({"mask_shift": {"dz": 1}}, "no parameter 'dz'; it has dx, dy"),
        ({"mask_shift": {"dx": 99}}, "mask_shift.dx must be a number from -32 to 32 pixel, got 99"),
        ({"mask_shift": {"dx": "left"}}, "mask_shift.dx must be a number"),
        ({"mask_shift": {"dx": float("nan")}}, "mask_shift.dx must be a number"),
        ({"mask_shift": 0.5}, "effects.mask_shift"),
        ({"pattern_order": {"offset": 0.5}}, "whole number"),
        ({"mask_orientation": {"operation": "mirror"}}, "flip_lr, flip_ud"),
        ({"bit_depth": {"bits": 9}}, "at most the file's bit depth 8"),
        ({"swapped_patterns": {"first": 0, "second": 4}}, "0 to 3"),
        ({"dead_column": {"column": 24}}, "0 to 23"),
        ({"short_slot": {"slot": 4}}, "0 to 3"),
        ([{"dx": 1}], "name: NAME"),
        (3, "names with parameters"),
    ],
)
def test_wrong_wishes(wish, message):
    with pytest.raises(BadInput, match=message):
        choose_effects(wish, SESSION, 0)


def test_wrong_numbers() -> None:
    for number in (0, 99, 1.5):
        with pytest.raises(BadInput, match="whole number from 1 to 35"):
            choose_effects("random", SESSION, 0, number=number)
    with pytest.raises(BadInput, match="clear, weak or faint"):
        choose_effects("gain", SESSION, 0, magnitude="huge")
    with pytest.raises(BadInput, match="square"):
        choose_effects({"mask_orientation": {"operation": "rot90"}}, Session(size=(16, 20)), 0)
    with pytest.raises(BadInput, match="seed"):
        VirtualCamera(SESSION).capture(-1)
