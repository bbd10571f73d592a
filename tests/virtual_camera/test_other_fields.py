"""Deviations from the calibration of other instruments do what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import OTHER_FIELDS, OUTSIDE, Session, choose_effects
from tests.virtual_camera.conftest import SMALL, Signal, one_capture

INPUT = replace(SMALL, surround="dark").acquisition(1)
LAST = len(INPUT.sequence) - 1


def test_there_are_ten_outside_the_vocabulary() -> None:
    assert len(OTHER_FIELDS) == 10 and set(OTHER_FIELDS) <= set(OUTSIDE)


def test_bright_spots_grow_fatter(signal: Signal) -> None:
    scene = np.full((2, 16, 16), 0.1)
    scene[:, 8, 8] = 0.9
    sharp = one_capture(np.full((2, 16, 16), 0.5), scene)
    wide = signal(sharp, brighter_fatter={"strength": 0.05})[0]
    flow = 0.05 * (0.9 + 0.1) / 2 * (0.9 - 0.1)
    assert wide[8, 8] == pytest.approx(0.9 - 4 * flow) and wide[7, 8] == pytest.approx(0.1 + flow)
    assert wide.sum() == pytest.approx(signal(sharp).sum()) and wide[8, 5] == pytest.approx(0.1)
    faint = one_capture(np.full((2, 16, 16), 0.5), scene / 10)
    spread = [(signal(one) - signal(one, brighter_fatter={"strength": 0.05}))[0, 8, 8] for one in (sharp, faint)]
    assert spread[0] == pytest.approx(100 * spread[1])  # with the square of the charge


def test_no_more_charge_flows_away_than_there_is(signal: Signal) -> None:
    scene = np.full((2, 16, 16), 0.1)
    scene[:, 8, 8] = 4.0
    assert signal(one_capture(np.full((2, 16, 16), 0.5), scene), brighter_fatter={"strength": 0.25}).min() >= 0


def test_capacitance_couples_neighbours_and_their_noise(signal: Signal) -> None:
    scene = np.zeros((2, 16, 16))
    scene[:, 0, 8] = 1
    seen = signal(one_capture(np.full((2, 16, 16), 0.5), scene), inter_pixel_capacitance={"coupling": 0.02})[0]
    assert seen[0, 8] == pytest.approx(0.94)  # three neighbours at the border
    assert seen[0, 7] == seen[1, 8] == pytest.approx(0.02) and seen[1, 7] == 0


def test_fringes_are_straight(signal: Signal) -> None:
    flat = one_capture(np.full((2, 16, 16), 0.5))
    seen = signal(flat, etalon_fringes={"amplitude": 0.1, "period": 8, "angle": 90})[0]
    np.testing.assert_allclose(seen, 1 + 0.1 * np.cos(2 * np.pi * np.arange(16) / 8)[:, None] + 0 * seen)


def test_codes_have_different_widths(signal: Signal) -> None:
    ramp = np.linspace(0, 1, 64 * 64).reshape(1, 64, 64).repeat(2, 0) / 2
    wish = {"differential_nonlinearity": {"mismatch": 0.05, "course": 3}}
    codes = np.round(signal(one_capture(ramp), **wish) * 255)
    counts = np.bincount(codes.astype(int).ravel(), minlength=256)[1:-1]  # 16 signals for a code of the right width
    assert counts.std() > 1 and abs(counts.mean() - 16) < 0.5 and (np.diff(codes.ravel()) >= 0).all()
    assert np.abs(codes / 255 - 2 * ramp[0]).max() < 0.06


def test_mirrors_open_late_and_close_in_time(signal: Signal) -> None:
    coding = np.zeros((4, 16, 16))
    coding[1:3] = 1
    scene = np.arange(1, 5)[:, None, None] / 16 * np.ones((1, 16, 16))
    seen = signal(one_capture(coding, scene), mirror_hysteresis={"share": 0.2})[0, 0, 0]
    assert seen == pytest.approx((0.8 * 2 + 3) / 16)


def test_the_door_is_open_for_some_captures(signal: Signal) -> None:
    more = signal(INPUT, door_leak={"strength": 0.1, "first": 3, "count": 2}) - signal(INPUT)
    assert (np.abs(more).max((1, 2)) > 0).nonzero()[0].tolist() == [3, 4]
    assert more[3, 5, 0] == pytest.approx(0.1 * (1 - 0.5 / 32)) and more[4, 0, -1] == pytest.approx(0.1 * 0.5 / 32)


def test_the_mask_drifts_from_capture_to_capture(signal: Signal) -> None:
    seen = signal(INPUT, mask_drift={"dx": 2.0})
    for number, dx in ((0, -1.0), (LAST, 1.0)):
        np.testing.assert_allclose(seen[number], signal(INPUT, mask_shift={"dx": dx})[number], atol=1e-12)


def test_two_captures_are_exchanged(signal: Signal) -> None:
    right, wrong = signal(INPUT), signal(INPUT, mislabelled_captures={"first": LAST - 2, "second": LAST})
    np.testing.assert_array_equal(wrong[[LAST - 2, LAST]], right[[LAST, LAST - 2]])
    np.testing.assert_array_equal(wrong[: LAST - 2], right[: LAST - 2])


def test_one_capture_is_moved(signal: Signal) -> None:
    wish = {"dx": 2.0, "dy": -1.0}
    changed = signal(INPUT, moved_capture={**wish, "capture": LAST}) != signal(INPUT)
    assert changed.any((1, 2)).nonzero()[0].tolist() == [LAST]
    moved = signal(INPUT, moved_capture={**wish, "capture": LAST})[LAST]
    expected = signal(INPUT, scene_shift=wish)[LAST]
    assert np.abs(moved - expected).max() < 1e-6


def test_one_capture_lacks_a_slot(signal: Signal) -> None:
    coding = np.eye(4)[:, :, None, None] * np.ones((16, 16))
    scene = np.ones((4, 16, 16))
    seen = signal(one_capture(coding[:, 0] * np.arange(4)[:, None, None] / 8, scene), dropped_slot={"slot": 1})
    assert seen.shape == (1, 16, 16)
    order = choose_effects({"dropped_slot": {"capture": 1, "slot": 2}}, SMALL, 0)["dropped_slot"].happened(INPUT)
    assert order.sequence[1].tolist() == [*INPUT.sequence[1, :2], INPUT.sequence[1, 3], INPUT.sequence[1, 0]]
    np.testing.assert_array_equal(np.delete(order.sequence, 1, 0), np.delete(INPUT.sequence, 1, 0))


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"dropped_slot": {"capture": 99, "slot": 1}}, "dropped_slot: the captures are 0 to 13, got 99"),
        ({"dropped_slot": {"capture": 1, "slot": 9}}, "dropped_slot.slot must be from -1 to 3, got 9"),
        ({"mislabelled_captures": {"first": 1, "second": 50}}, "the captures are 0 to 13, got 50"),
    ],
)
def test_captures_that_are_not_there(wish: dict[str, dict[str, float]], message: str) -> None:
    session = Session(size=(16, 16), frames=4, flat=2, all_on=1, all_off=1, dark=2, static=2, dynamic=2)
    with pytest.raises(BadInput, match=message):
        choose_effects(wish, session, 0)
