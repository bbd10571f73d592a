"""The physics of the textbook camera, its file, and the rule by which sealed rounds are drawn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.textbook_camera.camera import MIRROR_MARGIN, PIXEL_UM, SLOTS, Camera, Colour, Datasheet
from tests.textbook_camera.light import Bench, display, light_time, sample_places
from tests.textbook_camera.recording import mirror_patterns, pixel_means, save
from tests.textbook_camera.sensor import read_out
from tests.textbook_camera.suite import APART, GROUPS, Case, camera_of, cases, deviation, record, seed_of
from tests.textbook_camera.vocabulary import OUTSIDE, WORDS

SIZE = 16
ON, CODED = (SLOTS + 1,) * SLOTS, tuple(range(SLOTS))
BINARY, GRAY = Datasheet(), Datasheet(gray=True)


def bench(camera: Camera, datasheet: Datasheet = BINARY, size: int = SIZE) -> Bench:
    """Return the bench of a camera with random patterns."""
    return Bench(camera, mirror_patterns(datasheet, size, np.random.default_rng(0)), size, np.random.default_rng(1))


def white(on: Bench) -> np.ndarray:
    """Return a white target at rest, ``(1, n, n)``."""
    return np.ones((1, *on.radius2.shape))


def spot(camera: Camera, column: int, row: int, size: int = 32) -> tuple[float, float]:
    """Return where the image of one mirror lies, x and y in pixels from the axis."""
    mirrors = size + 2 * MIRROR_MARGIN
    patterns = np.zeros((1, mirrors, mirrors))
    patterns[0, MIRROR_MARGIN + row, MIRROR_MARGIN + column] = 1.0
    on = Bench(camera, patterns, size, np.random.default_rng(0))
    image, places = on.expose((0,) * SLOTS, white(on)), sample_places(size) / PIXEL_UM
    return float((image.sum(0) * places).sum() / image.sum()), float((image.sum(1) * places).sum() / image.sum())


@pytest.mark.parametrize(
    "camera",
    [
        Camera(),
        Camera(roll_rad=0.05, magnification_error=0.03, decentre_um=(7.0, -3.0), tilt=(0.02, 0.01), radial=-0.03),
        Camera(lens_sigma_um=(6.0, 4.0), corner_sigma_um=3.0, relay_sigma_um=5.0, glare=0.1, ghost=0.05),
        Camera(reset_slots=0.7, late_slots=0.3, colours=(Colour(0.5, 0.01), Colour(0.5, -0.01))),
        Camera(shutter_slots=0.6),
        Camera(planes=(3, 2, 1, 0)),
    ],
)
def test_open_mirrors_pass_all_light(camera: Camera) -> None:
    on = bench(camera)
    np.testing.assert_allclose(pixel_means(on.expose(ON, white(on)), SIZE), SLOTS, rtol=1e-9)


def test_gaps_between_mirrors_lose_the_fill_factor() -> None:
    on = bench(Camera(fill_factor=0.9))
    np.testing.assert_allclose(pixel_means(on.expose(ON, white(on)), SIZE), 0.9 * SLOTS, rtol=1e-9)


def test_a_duty_cycle_and_a_vignette_lose_what_they_say() -> None:
    on = bench(Camera(duty=0.8, vignetting=0.3))
    image = on.expose(ON, white(on)) / SLOTS
    edge = (len(image) - on.size * 4) // 2
    corner, centre = image[edge - 1 : edge + 1, edge - 1 : edge + 1].mean(), len(image) // 2
    assert corner == pytest.approx(0.8 * 0.7, rel=0.002)
    assert image[centre, centre] == pytest.approx(0.8, rel=0.002)


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        (Camera(), (10.5, 4.5)),
        (Camera(decentre_um=(1.3 * PIXEL_UM, -0.4 * PIXEL_UM)), (11.8, 4.1)),
        (Camera(magnification_error=0.03), (10.815, 4.635)),
        (Camera(roll_rad=0.1), (10.5 * np.cos(0.1) - 4.5 * np.sin(0.1), 4.5 * np.cos(0.1) + 10.5 * np.sin(0.1))),
        (Camera(radial=0.05), (10.5 * (1 + 0.05 * 130.5 / 512), 4.5 * (1 + 0.05 * 130.5 / 512))),
        (Camera(tilt=(0.04, 0.0)), (10.5 / (1 - 0.04 * 10.5 / 16), 4.5 / (1 - 0.04 * 10.5 / 16))),
        (Camera(orientation="flip_lr"), (-10.5, 4.5)),
        (Camera(orientation="transpose"), (4.5, 10.5)),
    ],
)
def test_the_relay_moves_a_spot_to_where_geometry_says(camera: Camera, expected: tuple[float, float]) -> None:
    assert spot(camera, column=26, row=20) == pytest.approx(expected, abs=0.008)


def test_a_blurred_spot_has_the_variance_of_its_parts() -> None:
    """Two squares of one pixel (mirror and pixel) and the point spread function: variances add."""
    size, sigma = 32, 1.2
    patterns = np.zeros((1, size + 2 * MIRROR_MARGIN, size + 2 * MIRROR_MARGIN))
    patterns[0, MIRROR_MARGIN + 16, MIRROR_MARGIN + 16] = 1.0
    for camera in (Camera(lens_sigma_um=(sigma * PIXEL_UM,) * 2), Camera(relay_sigma_um=sigma * PIXEL_UM)):
        on = Bench(camera, patterns, size, np.random.default_rng(0))
        profile = pixel_means(on.expose((0,) * SLOTS, white(on)), size).sum(0)
        variance = (profile * (np.arange(size) - 16.0) ** 2).sum() / profile.sum()
        assert variance == pytest.approx(sigma**2 + 1.0 / 6.0, rel=0.01)


def test_planes_of_a_gray_level_add_up_to_the_level() -> None:
    plain, planes = bench(Camera(), GRAY), bench(Camera(planes=(3, 2, 1, 0)), GRAY)
    np.testing.assert_allclose(planes.mask(CODED, False), plain.mask(CODED, False), atol=1e-12)
    weights = light_time(planes.camera, display(planes.camera, planes.patterns, CODED), np.array([0.0, SLOTS]))
    np.testing.assert_allclose(weights[0, :4, 0], np.array([8, 4, 2, 1]) / 15.0)


def test_what_is_late_comes_around_again() -> None:
    """A display that repeats itself sends the same light in one exposure, however late; a moving target sees it."""
    for camera in (Camera(reset_slots=0.7), Camera(shutter_slots=0.7), Camera(late_slots=0.4), Camera(slots_late=2)):
        plain, late = bench(Camera()), bench(camera)
        np.testing.assert_allclose(late.mask(CODED, False), plain.mask(CODED, False), atol=1e-9)
        assert np.abs(late.mask(CODED, True)[: SLOTS * 4] - plain.mask(CODED, True)).max() > 0.05


def test_photons_arrive_by_poisson_statistics() -> None:
    """The photon transfer curve: variance in DN^2 is mean in DN over electrons per DN, plus reading and rounding."""
    sheet = Datasheet(bit_depth=12, full_well_e=8_000.0, read_noise_dn=4.0)
    camera = Camera(full_scale_e=8_000.0, read_noise_dn=4.0, converter_bits=12)
    rngs = np.random.default_rng(0), np.random.default_rng(1)
    for level in (0.1, 0.5, 0.8):
        values = read_out(camera, sheet, np.full((8, 100, 100), level), *rngs).astype(float)
        assert values.mean() == pytest.approx(level * 4095, rel=1e-3)
        expected = level * 4095 * 4095 / 8_000.0 + 4.0**2 + 1.0 / 12.0
        assert values.var() == pytest.approx(expected, rel=0.02)


def test_the_converter_clips_and_rounds() -> None:
    rngs = np.random.default_rng(0), np.random.default_rng(1)
    light = np.stack([np.zeros((32, 32)), np.full((32, 32), 1.4), np.full((32, 32), 0.5)])
    values = read_out(Camera(), Datasheet(), light, *rngs)
    assert values.dtype == np.uint16
    assert values[0].min() == 0 and (values[1] == 1023).all()
    coarse = read_out(Camera(converter_bits=5), Datasheet(), light, *rngs)
    assert set(np.unique(coarse)) <= set(np.rint(np.arange(32) * 1023 / 31).astype(int).tolist())
    full = read_out(Camera(well=0.8), Datasheet(), light, *rngs)
    assert full[1].mean() == pytest.approx(0.8 * 1023, rel=1e-3)


def test_with_nothing_hidden_the_captures_follow_the_contract() -> None:
    """The nominal formula of the contract, in NumPy, and its noise: reduced chi-square 1 away from the clipped ends."""
    contents, _ = record(Case(), seed=3, size=48)
    shown = contents["patterns"][contents["sequence"]].astype(float)
    nominal = contents["aperture"][:, None, None] * (shown * contents["scene"]).sum(1)
    full, sheet = 2 ** contents["attributes"]["bit_depth"] - 1, contents["attributes"]
    variance = nominal / sheet["full_well_e"] + (sheet["read_noise_dn"] ** 2 + 1.0 / 12.0) / full**2
    inside = (nominal > 8.0 * np.sqrt(variance)) & (nominal < 1.0 - 5.0 * np.sqrt(variance))
    measured = contents["measurement"] / full
    assert inside.mean() > 0.5
    assert ((measured - nominal)[inside] ** 2 / variance[inside]).mean() == pytest.approx(1.0, abs=0.02)
    assert (measured[nominal > 1.0 + 6.0 * np.sqrt(variance)] == 1.0).all()


def test_the_file_keeps_the_contract(tmp_path: Path) -> None:
    case = Case("laboratory", {"gain": {"factor": 0.95}}, GRAY)
    save(tmp_path / "one.h5", *record(case, seed=1, size=SIZE))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.h5", "one.truth.json"]
    with h5py.File(tmp_path / "one.h5") as file:
        assert file.attrs["format"] == "sci-captures" and file.attrs["format_version"] == 1
        assert {"bit_depth", "read_noise_dn", "full_well_e", "name"} <= set(file.attrs)
        kinds = {
            "patterns": "f4",
            "sequence": "i8",
            "measurement": "u2",
            "scene": "f4",
            "aperture": "f4",
            "exposure": "f4",
        }
        assert {name: file[name].dtype.str[1:] for name in kinds} == kinds
        assert file["patterns"].shape == (SLOTS + 2, SIZE, SIZE) and file["measurement"].shape == (34, SIZE, SIZE)
        assert file["scene"].shape == (34, SLOTS, SIZE, SIZE) and file["sequence"].shape == (34, SLOTS)
        patterns, scene = file["patterns"][:], file["scene"][:]
        assert (
            patterns.min() == 0.0 and patterns.max() == 1.0 and not patterns[SLOTS].any() and patterns[SLOTS + 1].all()
        )
        assert scene.min() >= 0.0 and scene.max() <= 1.0
        assert set(file["kind"].asstr()[:]) == {"dark", "flat", "pattern", "static", "dynamic"}
    truth = json.loads((tmp_path / "one.truth.json").read_text())
    assert truth["hidden"][0]["accepted"] == ["duty_cycle", "gain"]
    assert truth["hidden"][0]["parameters"] == {"factor": 0.95}


def test_the_seed_draws_the_file() -> None:
    first, again, other = (record(Case(), seed_of(round_, 1), SIZE)[0] for round_ in (0, 0, 1))
    assert all(np.array_equal(first[name], again[name]) for name in ("patterns", "measurement", "scene"))
    assert not np.array_equal(first["measurement"], other["measurement"])


@pytest.mark.parametrize("round_", range(3))
def test_a_round_is_composed_as_stated(round_: int) -> None:
    drawn = cases(round_)
    assert [case.group for case in drawn] == [group for group, (count, _) in GROUPS.items() for _ in range(count)]
    assert all(len(case.hidden) == GROUPS[case.group][1] for case in drawn)
    named = [name for case in drawn for name in case.hidden if case.group != "outside"]
    assert set(named) == set(WORDS)
    assert all(name in OUTSIDE for case in drawn if case.group == "outside" for name in case.hidden)
    assert not any(len(group & set(case.hidden)) > 1 for group in APART for case in drawn)
    assert all(case.datasheet.gray for case in drawn if any(deviation(name).gray for name in case.hidden))
    assert all(camera_of(case, np.random.default_rng(0)) != Camera() for case in drawn if case.hidden)
    json.dumps([case.hidden for case in drawn])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*WORDS, *OUTSIDE])
def test_every_deviation_changes_the_captures(name: str) -> None:
    """With the same photons drawn, a deviation moves a part of the values by more than one DN."""
    sheet = replace(BINARY, gray=deviation(name).gray)
    values = deviation(name).draw(np.random.default_rng(0), sheet)
    plain = record(Case(datasheet=sheet), 5, SIZE)[0]["measurement"].astype(float)
    changed = record(Case(hidden={name: values}, datasheet=sheet), 5, SIZE)[0]["measurement"].astype(float)
    assert (np.abs(changed - plain) > 1.0).any()
