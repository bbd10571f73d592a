"""Every effect: does nothing at its neutral value, something elsewhere, and in the direction it says."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from sci_lightning.virtual_camera import EFFECTS, OUTSIDE, VOCABULARY
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.random_numbers import stream
from tests.virtual_camera.conftest import SMALL, Signal, one_capture, one_mirror

STAGES = ("capture", "scene", "modulator", "relay", "exposure", "optics", "sensor")
INPUT = SMALL.acquisition(1)
IDEAL = Camera(SMALL, {}, 1)


def one_slot_each(slots=4, size=(16, 16)):
    """Slot t shows t / 8 in every mirror, so that the light tells which pattern met which frame."""
    return np.ones((slots, *size)) * np.arange(slots)[:, None, None] / 8


def test_the_vocabulary_is_the_documented_one() -> None:
    documented = {
        "scene": "scene_shift scene_rotation scene_scale scene_blur scene_gamma",
        "modulator": "pattern_order mask_orientation mask_level_gamma mask_contrast mask_lag sync_offset",
        "relay": "mask_shift mask_rotation mask_scale lateral_colour mask_blur mask_distortion mask_keystone",
        "exposure": "flicker rolling_shutter duty_cycle phased_reset bit_planes",
        "optics": "optical_blur field_blur vignetting illumination veiling_glare",
        "sensor": "gain prnu shot_noise saturation response_gamma black_level column_noise row_noise hot_pixels "
        "read_noise bit_depth",
    }
    assert {name: effect.stage for name, effect in VOCABULARY.items()} == {
        name: stage for stage, names in documented.items() for name in names.split()
    }
    stages = [STAGES.index(effect.stage) for effect in EFFECTS.values()]
    assert stages == sorted(stages)
    assert not set(OUTSIDE) & set(VOCABULARY)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", EFFECTS)
def test_neutral_is_the_identity_and_drawn_is_not(name: str, seed: int) -> None:
    neutral = Camera(SMALL, {name: EFFECTS[name].neutral(SMALL)}, 1)
    np.testing.assert_allclose(neutral.irradiance(INPUT), IDEAL.irradiance(INPUT), atol=1e-12)
    np.testing.assert_array_equal(neutral.record(INPUT), IDEAL.record(INPUT))
    drawn = EFFECTS[name].draw(stream(seed, name), SMALL)
    assert EFFECTS[name].from_values(drawn.values, SMALL) == drawn  # what is drawn could have been given
    camera = Camera(SMALL, {name: drawn}, 1)
    assert (camera.record(INPUT) != IDEAL.record(INPUT)).sum() > 5, drawn


PAIRS = list(combinations(EFFECTS, 2))


@pytest.mark.parametrize(
    ("first", "second"), [*PAIRS[::101], *(pytest.param(*pair, marks=pytest.mark.slow) for pair in PAIRS[1::17])]
)
def test_effects_combine(first: str, second: str) -> None:
    pair = {name: EFFECTS[name].draw(stream(5, name), SMALL) for name in (second, first)}
    recorded = Camera(SMALL, pair, 1).record(INPUT)
    assert recorded.shape == INPUT.scene[:, 0].shape
    for name in pair:
        assert (recorded != Camera(SMALL, {name: pair[name]}, 1).record(INPUT)).any()


def test_ideal_light_is_the_nominal_measurement() -> None:
    nominal = (INPUT.patterns[INPUT.sequence] * INPUT.scene).sum(1, dtype=np.float64) * INPUT.aperture[:, None, None]
    np.testing.assert_allclose(IDEAL.irradiance(INPUT), nominal, atol=1e-12)


def test_pattern_order(signal: Signal) -> None:
    coding, scene = one_slot_each(), np.zeros((4, 16, 16))
    scene[2] = 1
    for offset in (1, -1, 5):
        assert signal(one_capture(coding, scene), pattern_order={"offset": offset})[0, 0, 0] == (2 - offset) % 4 / 8


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        ("flip_lr", lambda m: m[:, ::-1]),
        ("flip_ud", lambda m: m[::-1]),
        ("rot90", np.rot90),
        ("rot180", lambda m: np.rot90(m, 2)),
        ("rot270", lambda m: np.rot90(m, 3)),
        ("transpose", np.transpose),
        ("antitranspose", lambda m: np.rot90(m, 2).T),
    ],
)
def test_mask_orientation(signal, operation, expected):
    coding = np.random.default_rng(0).random((2, 17, 17)) / 2
    np.testing.assert_allclose(
        signal(one_capture(coding), mask_orientation={"operation": operation})[0], expected(coding.sum(0)), atol=1e-12
    )


def test_mask_levels_and_contrast(signal: Signal) -> None:
    coding = np.full((2, 16, 16), 0.25)
    assert signal(one_capture(coding), mask_level_gamma={"gamma": 2})[0, 0, 0] == 2 * 0.25**2
    assert signal(one_capture(coding), mask_contrast={"leak": 0.1})[0, 0, 0] == pytest.approx(2 * (0.1 + 0.9 * 0.25))


def test_mask_lag_starts_from_the_last_pattern(signal: Signal) -> None:
    told, lag = one_slot_each()[:, 0, 0], 0.3
    shown = told[-1]
    for slot in range(4):
        shown = (1 - lag) * told[slot] + lag * shown
        scene = np.zeros((4, 16, 16))
        scene[slot] = 1
        seen = signal(one_capture(one_slot_each(), scene), mask_lag={"lag": lag})
        assert seen[0, 0, 0] == pytest.approx(shown)


@pytest.mark.parametrize(("offset", "neighbour"), [(0.3, 3), (-0.3, 1)])
def test_sync_offset(signal, offset, neighbour):
    scene = np.zeros((4, 16, 16))
    scene[0] = 1
    told = one_slot_each()[:, 0, 0]
    seen = signal(one_capture(one_slot_each(), scene), sync_offset={"offset": offset})
    assert seen[0, 0, 0] == pytest.approx(0.7 * told[0] + 0.3 * told[neighbour])


def test_flicker_is_integrated_over_each_slot(signal: Signal) -> None:
    for slot in range(4):
        scene = np.zeros((4, 16, 16))
        scene[slot] = 1
        seen = signal(
            one_capture(np.ones((4, 16, 16)), scene), flicker={"amplitude": 0.2, "frequency": 1.7, "phase": 0.4}
        )
        moments = slot + (np.arange(1000) + 0.5) / 1000
        shining = 1 + 0.2 * np.sin(2 * np.pi * 1.7 * moments / 4 + 0.4)
        assert seen[0, 0, 0] == pytest.approx(shining.mean(), abs=1e-6)


def test_duty_cycle_is_less_light_and_cuts_off_flicker(signal: Signal) -> None:
    coding, beat = np.full((4, 16, 16), 0.25), {"amplitude": 0.5, "frequency": 4.0, "phase": 0.0}
    assert signal(one_capture(coding), duty_cycle={"fraction": 0.7})[0, 0, 0] == pytest.approx(0.7)
    seen = signal(one_capture(coding), duty_cycle={"fraction": 0.5}, flicker=beat)[0, 0, 0]
    moments = (np.arange(1000) + 0.5) / 2000  # the first half of every slot, in which the source is bright
    assert seen == pytest.approx((0.5 + 0.25 * np.sin(2 * np.pi * moments)).mean(), abs=1e-5)


def test_targets(signal: Signal) -> None:
    y, x = np.indices((40, 40)) - 19.5
    spot = 0.8 * np.exp(-((x - 6) ** 2 + (y - 2) ** 2) / 18)
    even = np.full((2, 40, 40), 0.5)

    def shown(**wish: dict[str, float]) -> np.ndarray:
        return signal(one_capture(even, np.stack([spot, spot])), **wish)[0]

    def place(image: np.ndarray) -> tuple[float, float]:
        return float((image * x).sum() / image.sum()), float((image * y).sum() / image.sum())

    middle = place(spot)
    moved = place(shown(scene_shift={"dx": 0.6, "dy": -0.3}))
    assert moved == pytest.approx((middle[0] + 0.6, middle[1] - 0.3), abs=0.01)
    turned = place(shown(scene_rotation={"angle": 10.0}))
    assert turned[1] > middle[1] and turned[0] < middle[0]  # clockwise
    assert place(shown(scene_scale={"scale": 1.1}))[0] == pytest.approx(1.1 * middle[0], abs=0.1)
    wide = 0.8 * 9 / 10 * np.exp(-((x - 6) ** 2 + (y - 2) ** 2) / 20)
    np.testing.assert_allclose(shown(scene_blur={"sigma": 1.0}), wide, atol=2e-3)
    np.testing.assert_allclose(shown(scene_gamma={"gamma": 2.0}), spot**2, atol=1e-6)
    grey = one_capture(even, 0.5)
    assert signal(grey, scene_gamma={"gamma": 2.0})[0, 0, 0] == pytest.approx(0.25)
    np.testing.assert_allclose(signal(grey, scene_shift={"dx": 3.0}), signal(grey), atol=1e-9)


def test_rolling_shutter(signal: Signal) -> None:
    coding = one_slot_each()
    scene = np.ones((4, 16, 16)) * np.array([0.1, 0.2, 0.3, 0.4])[:, None, None]
    seen = signal(one_capture(coding, scene), rolling_shutter={"delay": 1.5})[0, :, 0]
    told, frame = coding[:, 0, 0], scene[:, 0, 0]
    assert seen[0] == pytest.approx((told * frame).sum())
    # the last row: half of slot 1, slots 2 and 3, then patterns 0 and half of 1 with the last frame held
    held = frame[3] * (told[0] + 0.5 * told[1] * 2)
    late = 0.5 * told[1] * frame[1] + told[2] * frame[2] + told[3] * frame[3] + held - 0.5 * told[1] * frame[3]
    assert seen[-1] == pytest.approx(late)
    assert seen[5] == pytest.approx(signal(one_capture(coding, scene), rolling_shutter={"delay": 0.5})[0, -1, 0])


def test_phased_reset(signal: Signal) -> None:
    told, scene = one_slot_each()[:, 0, 0], np.zeros((4, 16, 16))
    scene[2] = 1
    seen = signal(one_capture(one_slot_each(), scene), phased_reset={"delay": 0.3})[0]
    late = 0.3 * np.arange(16) / 15
    np.testing.assert_allclose(seen, np.tile((1 - late) * told[2] + late * told[1], (16, 1)).T)
    # what is late meets the light of that moment
    pulse = {"amplitude": 1.0, "frequency": 4.0, "phase": np.pi}
    late, on_time = (
        signal(one_capture(one_slot_each(), scene), flicker=pulse, **wish)[0, -1, 0]
        for wish in ({"phased_reset": {"delay": 0.3}}, {})
    )
    assert on_time - late == pytest.approx((0.3 - (1 - np.cos(0.6 * np.pi)) / (2 * np.pi)) / 8)


def test_bit_planes(signal: Signal) -> None:
    coding, scene = np.full((4, 16, 16), 5 / 16), np.ones((4, 16, 16)) * np.array([0.1, 0.3, 0.2, 0.6])[:, None, None]
    change = np.array([0.2, 0.05, 0.15, 0.4])
    coding[0] = 1 / 16  # so that the levels need four bits
    for order, middles in (("msb_first", (14.5 / 15, 10 / 15)), ("lsb_first", (0.5 / 15, 5 / 15))):
        seen = signal(one_capture(coding, scene), bit_planes={"order": order})[0, 0, 0]
        least, third = (scene[:, 0, 0] + (middle - 0.5) * change for middle in middles)
        assert seen == pytest.approx((least.sum() + 4 * third[1:].sum()) / 16)
    still = one_capture(coding, 0.5)
    np.testing.assert_allclose(signal(still, bit_planes={"order": "msb_first"}), signal(still), atol=1e-12)
    twice = signal(one_capture(coding, scene), bit_planes={"order": "msb_first"}, phased_reset={"delay": 0.4})[0]
    once = signal(one_capture(coding, scene), bit_planes={"order": "msb_first"})[0]
    np.testing.assert_allclose(twice[0], once[0])
    assert (np.abs(twice[-1] - once[-1]) > 1e-3).all()


def test_planes_before_a_scene_that_lights_up(signal: Signal) -> None:
    coding, scene = np.zeros((2, 16, 16)), np.zeros((2, 16, 16))
    coding[0], scene[1] = 1 / 4, 1
    coding[1, 0] = 1 / 2
    assert signal(one_capture(coding, scene), bit_planes={"order": "lsb_first"})[0, 1:].max() == 0
    assert signal(one_capture(coding, scene), bit_planes={"order": "msb_first"})[0, 1:].min() > 0


def test_field_blur_is_an_optical_blur_of_every_place(signal: Signal) -> None:
    for row, column in ((8, 8), (12, 3)):
        place = ((row - 8) ** 2 + (column - 8) ** 2) / 128
        seen = signal(one_mirror(row, column, (17, 17)), field_blur={"centre": 0.3, "corner": 1.1})
        blurred = signal(one_mirror(row, column, (17, 17)), optical_blur={"sigma": 0.3 + 0.8 * place})
        np.testing.assert_allclose(seen, blurred, atol=1e-9)


def test_lateral_colour(signal: Signal) -> None:
    coding = np.random.default_rng(0).random((2, 17, 16)) / 2
    larger, smaller = (signal(one_capture(coding), mask_scale={"scale": scale}) for scale in (1.02, 0.98))
    seen = signal(one_capture(coding), lateral_colour={"spread": 0.02})
    np.testing.assert_allclose(seen, (larger + smaller) / 2, atol=1e-12)


def test_vignetting(signal: Signal) -> None:
    seen = signal(one_capture(np.full((2, 17, 31), 0.5)), vignetting={"strength": 0.3})[0]
    assert seen[8, 15] == 1
    assert seen[0, 0] == seen[-1, -1] == seen[0, -1] == pytest.approx(0.7)
    assert seen[8, 0] == pytest.approx(1 - 0.3 * 15**2 / (15**2 + 8**2))


def test_veiling_glare_keeps_the_light(signal: Signal) -> None:
    coding = np.random.default_rng(0).random((2, 16, 16)) / 2
    seen = signal(one_capture(coding), veiling_glare={"fraction": 0.2})[0]
    np.testing.assert_allclose(seen, 0.8 * coding.sum(0) + 0.2 * coding.sum(0).mean())


def test_response(signal: Signal) -> None:
    grey = one_capture(np.full((2, 16, 16), 0.25))
    assert signal(grey, gain={"factor": 1.2})[0, 0, 0] == pytest.approx(0.6)
    assert signal(grey, response_gamma={"gamma": 2})[0, 0, 0] == pytest.approx(0.25)
    assert signal(grey, saturation={"level": 0.4})[0, 0, 0] == pytest.approx(0.4)
    assert signal(grey, black_level={"offset": -0.1})[0, 0, 0] == pytest.approx(0.4)
    assert signal(grey, gain={"factor": 3}, saturation={"level": 0.8}, black_level={"offset": 0.1})[0, 0, 0] == 0.9
    low, high = (
        signal(one_capture(np.full((2, 16, 16), v / 2)), s_shaped_response={"strength": 0.5}) for v in (0.2, 0.8)
    )
    assert low[0, 0, 0] < 0.2 and high[0, 0, 0] > 0.8


def test_maps_have_the_stated_deviation(signal: Signal) -> None:
    grey = one_capture(np.full((2, 24, 40), 0.25))
    gains = signal(grey, prnu={"std": 0.03})[0] / 0.5
    assert gains.mean() == pytest.approx(1) and gains.std() == pytest.approx(0.03)
    columns = signal(grey, column_noise={"std": 0.01})[0] - 0.5
    assert np.ptp(columns, 0).max() < 1e-12 and columns[0].std() == pytest.approx(0.01)
    rows = signal(grey, row_noise={"std": 0.01})[0] - 0.5
    assert np.ptp(rows, 1).max() < 1e-12 and rows[:, 0].std() == pytest.approx(0.01)


def test_dark_signal_grows_with_exposure(signal: Signal) -> None:
    once, twice = (one_capture(np.zeros((2, 32, 32)), exposure=time) for time in (1, 2))
    for wish in ({"hot_pixels": {"fraction": 0.01}}, {"light_leak": {"strength": 0.1}}):
        np.testing.assert_allclose(signal(twice, **wish), 2 * signal(once, **wish))
    hot = signal(once, hot_pixels={"fraction": 0.01})
    assert np.count_nonzero(hot) == 10 and hot.max() <= 0.6
    leak = signal(once, light_leak={"strength": 0.1, "edge": "right"})[0]
    assert (np.diff(leak, axis=1) > 0).all() and leak[0, -1] == pytest.approx(0.1, rel=0.1)


def test_ghost_lies_where_it_says(signal: Signal) -> None:
    seen = signal(one_mirror(), ghost={"fraction": 0.1, "dx": 3, "dy": -2})[0]
    assert seen[8, 5] == pytest.approx(0.9) and seen[6, 8] == pytest.approx(0.1)


def test_astigmatism_blurs_light_along_x_only(signal: Signal) -> None:
    seen = signal(one_mirror(), astigmatism={"sigma": 0.7}, optical_blur={"sigma": 0.5})[0]
    for axis, sigma in ((0, np.hypot(0.7, 0.5)), (1, 0.5)):
        np.testing.assert_allclose(seen.sum(axis), signal(one_mirror(), optical_blur={"sigma": sigma})[0].sum(axis))


def test_flare_keeps_the_light(signal: Signal) -> None:
    coding = np.random.default_rng(0).random((2, 40, 50)) / 2
    wish = {"flare": {"fraction": 0.2, "x": 0.7, "y": 0.3, "radius": 0.05}}
    added = signal(one_capture(coding), **wish)[0] - 0.8 * coding.sum(0)
    assert added.sum() == pytest.approx(0.2 * coding.sum())
    row, column = np.unravel_index(added.argmax(), added.shape)
    assert row in (11, 12) and column in (34, 35)  # (0.3, 0.7) of the sides
    assert added[:, :20].max() < 1e-3


def test_swapped_patterns_and_short_slot(signal: Signal) -> None:
    scene = np.zeros((4, 16, 16))
    scene[1] = 1
    coding = one_slot_each()
    assert signal(one_capture(coding, scene), swapped_patterns={"first": 1, "second": 3})[0, 0, 0] == coding[3, 0, 0]
    assert signal(one_capture(coding, scene), short_slot={"slot": 1, "loss": 0.2})[0, 0, 0] == 0.8 * coding[1, 0, 0]


def test_light_differs_by_slot_or_by_capture(signal: Signal) -> None:
    seen, again, other = (signal(INPUT, unsteady_source={"std": 0.05, "course": course}) for course in (3, 3, 4))
    lit = INPUT.scene.any((1, 2, 3)) & INPUT.patterns[INPUT.sequence].any((1, 2, 3))
    power = seen[lit].sum((1, 2)) / signal(INPUT)[lit].sum((1, 2))
    assert 0.02 < power.std() < 0.08 and abs(power.mean() - 1) < 0.03
    assert (seen == again).all() and (seen != other).any()
    levels = []
    for slot in range(4):
        scene = np.zeros((4, 16, 16))
        scene[slot] = 1
        seen = signal(one_capture(np.ones((4, 16, 16)) / 4, scene), uneven_slots={"std": 0.1, "course": 3})
        levels.append(4 * seen[0, 0, 0])
    assert np.mean(levels) == pytest.approx(1) and np.std(levels) == pytest.approx(0.1)


def test_gains_by_row_column_and_capture(signal: Signal) -> None:
    grey = one_capture(np.full((2, 16, 16), 0.25))
    rows = signal(grey, interlaced_gain={"difference": 0.1})[0, :, 0]
    assert rows[0] == pytest.approx(0.525) and rows[1] == pytest.approx(0.475)
    assert signal(grey, dead_column={"column": 4, "loss": 1.0})[0, :, 4].max() == 0
    drifted = signal(INPUT, drifting_source={"drift": 0.1}) / np.maximum(signal(INPUT), 1e-9)
    assert drifted[-1].max() == pytest.approx(1.05) and drifted[2].max() < 0.98


def test_a_capture_leaves_a_part_of_itself_in_the_next(signal: Signal) -> None:
    ideal, seen = signal(INPUT), signal(INPUT, image_lag={"fraction": 0.03})
    np.testing.assert_allclose(seen[1:] - ideal[1:], 0.03 * ideal[:-1], atol=1e-12)
    np.testing.assert_array_equal(seen[0], ideal[0])


def test_banding_moves_on_from_capture_to_capture(signal: Signal) -> None:
    wave = signal(INPUT, banding={"amplitude": 0.02, "period": 8, "advance": 0.25}) - signal(INPUT)
    assert np.ptp(wave, axis=2).max() < 1e-12
    np.testing.assert_allclose(wave[0, :, 0], 0.02 * np.sin(2 * np.pi * np.arange(32) / 8), atol=1e-12)
    np.testing.assert_allclose(wave[1, :-2, 0], wave[0, 2:, 0], atol=1e-12)


def test_rows_flutter_anew_in_every_capture() -> None:
    dark = SMALL.acquisition(1)
    fluttering = Camera(SMALL, {"row_flutter": EFFECTS["row_flutter"].from_values({"std": 0.02}, SMALL)}, 1)
    random = stream(1, "noise")
    offset = (fluttering.signal(np.full(dark.scene[:, 0].shape, 0.5), dark, random) - 0.5).mean(2)  # (N, H)
    assert offset.std() == pytest.approx(0.02, rel=0.1)
    assert abs(np.corrcoef(offset[0], offset[1])[0, 1]) < 0.5
    still = Camera(SMALL, {}, 1).signal(np.full(dark.scene[:, 0].shape, 0.5), dark, stream(1, "noise"))
    assert (still - 0.5).mean(2).std() < 0.002


def test_converter_step(signal: Signal) -> None:
    for level, expected in ((0.4, 0.4), (0.6, 0.63)):
        seen = signal(one_capture(np.full((2, 16, 16), level / 2)), converter_step={"step": 0.03})
        assert seen[0, 0, 0] == pytest.approx(expected)
