"""The mirrors' image against areas counted by brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from sci_lightning.virtual_camera.hardware.relay import Relay
from tests.virtual_camera.conftest import SMALL, Signal, one_capture, one_mirror

RANDOM = np.random.default_rng(2).random((1, 12, 15))


def seen(relay, patterns=RANDOM, surround="dark", oversampling=4):
    """(H, W) averages over pixels."""
    height, width = patterns.shape[1:]
    return fine(relay, patterns, surround, oversampling).reshape(height, oversampling, width, oversampling).mean((1, 3))


def fine(relay, patterns=RANDOM, surround="dark", oversampling=4):
    """(n H, n W) averages over even cells."""
    rows, columns = (np.arange(oversampling * length + 1) / oversampling for length in patterns.shape[1:])
    return relay.image(patterns, rows, columns, surround)[0]


def counted(relay, surround="dark", n=40):
    """The same by tracing n x n points per pixel back to the mirrors."""
    height, width = RANDOM.shape[1:]
    y, x = (np.arange(n * length)[:, None] / n + 0.5 / n - length / 2 for length in (height, width))
    seen = np.hypot(y, x.T)
    half = np.hypot(height, width) / 2
    table = np.linspace(0, 1.5 * half, 100_000)  # where what belongs at a radius is seen
    part = np.interp(seen, table * (1 + relay.k * (table / half) ** 2), table) / np.maximum(seen, 1e-9)
    y, x = y * part, x.T * part
    w = 1 + 2 * relay.tilt_x * x / width + 2 * relay.tilt_y * y / height  # a plane seen at an angle
    y, x = y / w - relay.dy, x / w - relay.dx
    cos, sin = np.cos(relay.angle) / relay.scale, np.sin(relay.angle) / relay.scale
    u, v = cos * x + sin * y, cos * y - sin * x
    column, row = np.floor(u + width / 2).astype(int), np.floor(v + height / 2).astype(int)
    light = RANDOM[0][row.clip(0, height - 1), column.clip(0, width - 1)]
    if surround == "dark":
        light = light * ((row >= 0) & (row < height) & (column >= 0) & (column < width))
    return light.reshape(height, n, width, n).mean((1, 3))


@pytest.mark.parametrize("surround", ["dark", "edge"])
@pytest.mark.parametrize(
    "relay",
    [
        Relay(),
        Relay(dx=0.61, dy=-0.35),
        Relay(dx=-3.2, scale=1.04),
        Relay(angle=0.02),
        Relay(angle=-0.3, scale=0.93, dx=1.3, dy=0.4),
        Relay(tilt_y=0.05, dx=0.3),
        Relay(tilt_x=-0.04, tilt_y=0.02, angle=0.01, scale=1.02),
        Relay(k=0.05),
        Relay(k=-0.04, dy=-0.4, tilt_x=0.03),
    ],
)
def test_areas(relay, surround):
    np.testing.assert_allclose(seen(relay, surround=surround), counted(relay, surround), atol=0.02)


def test_a_fraction_of_a_pixel_is_linear_interpolation() -> None:
    image = seen(Relay(dx=0.25, dy=-0.5))
    expected = 0.75 * RANDOM[0] + 0.25 * np.pad(RANDOM[0], ((0, 0), (1, 0)))[:, :-1]
    expected = 0.5 * expected + 0.5 * np.pad(expected, ((0, 1), (0, 0)))[1:]
    np.testing.assert_allclose(image, expected, atol=1e-12)


@pytest.mark.parametrize("sigma", [0.0, 0.2, 0.9])
@pytest.mark.parametrize("surround", ["dark", "edge"])
def test_turned_by_nothing_is_upright(sigma, surround):
    upright, turned = (fine(Relay(angle, 1.01, 0.3, -0.7, sigma, 0.4), RANDOM, surround, 3) for angle in (0.0, 1e-9))
    np.testing.assert_allclose(turned, upright, atol=1e-6)


@pytest.mark.parametrize("sigma", [0.3, 1.0])
def test_blur_widens_by_its_variance(sigma):
    mirror = np.zeros((1, 25, 25))
    mirror[0, 12, 12] = 1
    image = fine(Relay(sigma=sigma), mirror, oversampling=16)
    place = (np.arange(25 * 16) + 0.5) / 16 - 12.5
    assert image.sum() / 16**2 == pytest.approx(1)
    # a square of side 1 has 1/12, a cell that it is averaged over 1/12/16**2
    assert (image.sum(0) * place**2).sum() / image.sum() == pytest.approx(sigma**2 + 1 / 12 + 1 / 12 / 256)


def test_astigmatism_blurs_along_x_only(signal: Signal) -> None:
    seen = signal(one_mirror(), mask_astigmatism={"sigma": 0.7})[0]
    assert seen[8].sum() == pytest.approx(1) and seen[8, 5] < 0.6
    both = signal(one_mirror(), mask_astigmatism={"sigma": 0.7}, mask_blur={"sigma": 0.5})[0]
    alone = signal(one_mirror(), mask_blur={"sigma": np.hypot(0.7, 0.5)})[0]
    np.testing.assert_allclose(both.sum(0), alone.sum(0), atol=1e-9)
    np.testing.assert_allclose(both.sum(1), signal(one_mirror(), mask_blur={"sigma": 0.5})[0].sum(1), atol=1e-9)


def test_keystone_and_distortion_move_what_is_far_from_the_middle(signal: Signal) -> None:
    low = one_mirror(15, 14, (17, 17))
    assert signal(low, mask_keystone={"tilt_y": 0.2})[0].argmax() > 15 * 17 + 14  # larger at the lower end
    assert signal(low, mask_distortion={"k": -0.2})[0].argmax() < 15 * 17
    middle = one_mirror(8, 8, (17, 17))
    for wish in ({"mask_keystone": {"tilt_x": 0.2}}, {"mask_distortion": {"k": 0.2}}):
        assert signal(middle, **wish)[0, 8, 8] > 0.95


def test_light_that_crosses_into_the_next_pixel(signal: Signal) -> None:
    """Of a square blurred by sigma, sigma / sqrt(2 pi) leaves over each side, by whichever lens."""
    for name in ("mask_blur", "optical_blur"):
        image = signal(one_mirror(), **{name: {"sigma": 0.2}})[0]
        assert image[8].sum() / image.sum() == pytest.approx(1 - 2 * 0.2 / np.sqrt(2 * np.pi), abs=1e-6)


def test_mask_blur_leaves_the_scene_and_optical_blur_does_not(signal: Signal) -> None:
    scene = np.zeros((2, 16, 16))
    scene[:, :, 8:] = 1
    even = one_capture(np.full((2, 16, 16), 0.5), scene)
    assert signal(even, mask_blur={"sigma": 1.0})[0, 8, 7] == 0
    assert signal(even, optical_blur={"sigma": 1.0})[0, 8, 7] > 0.2


def test_shift_moves_right_and_down(signal: Signal) -> None:
    image = signal(one_mirror(8, 5), mask_shift={"dx": 2, "dy": 1})[0]
    assert image[9, 7] == pytest.approx(1) and image.sum() == pytest.approx(1)


def test_rotation_is_clockwise_and_scale_is_outward(signal: Signal) -> None:
    right = one_mirror(8, 14, (17, 17))  # to the right of the middle
    row, column = np.unravel_index(signal(right, mask_rotation={"angle": 30})[0].argmax(), (17, 17))
    assert row > 8 and column < 14
    assert signal(right, mask_scale={"scale": 1.2})[0, 8].argmax() == 15


def test_both_turns_are_about_the_middle(signal: Signal) -> None:
    middle = one_mirror(8, 8, (17, 17))
    assert signal(middle, mask_rotation={"angle": 10}, mask_scale={"scale": 1.1})[0].argmax() == 8 * 17 + 8
    moved = signal(middle, mask_rotation={"angle": 10}, mask_shift={"dx": 3})[0]
    assert moved.argmax() == 8 * 17 + 11


def test_cells_are_as_fine_as_the_light_is_uneven() -> None:
    def count(relay, *, sharp=False, oversampling=8):
        rows, columns = relay.cells((16, 20), oversampling, sharp_optics=sharp)
        assert rows[0] == columns[0] == 0 and rows[-1] == 16 and columns[-1] == 20
        return len(rows) - 1, len(columns) - 1

    assert count(Relay()) == count(Relay(dx=0.3, sigma=1.0), sharp=True) == (16, 20)
    assert count(Relay(dx=0.3)) == (16, 40)
    assert count(Relay(dx=1.0, dy=0.5)) == (32, 20)
    assert count(Relay(sigma=0.3)) == count(Relay(angle=0.1)) == (128, 160)
    assert count(Relay(dx=0.3, sigma=0.3), oversampling=1) == (16, 20)


def test_a_displaced_mask_blurred_again_is_exact(signal: Signal) -> None:
    """Half a mirror lights half a pixel, not all of it evenly, and the next lens knows the difference."""
    wish = {"mask_shift": {"dx": 0.4}, "optical_blur": {"sigma": 0.5}}
    seen = signal(one_mirror(), **wish)[0, 8]
    x = 5.4 + (np.arange(2000) + 0.5) / 2000  # where the square's light falls
    edges = np.arange(17)
    falls = np.diff(ndtr((edges[:, None] - x) / 0.5), axis=0).mean(1)
    np.testing.assert_allclose(seen / seen.sum(), falls, atol=1e-6)
    coarse = signal(one_mirror(), session=replace(SMALL, oversampling=1), **wish)[0, 8]
    assert np.abs(coarse - seen).max() > 0.02


def test_a_blurred_mask_blurred_again_is_nearly_exact(signal: Signal) -> None:
    once = signal(one_mirror(), optical_blur={"sigma": 0.5})[0]
    twice = signal(one_mirror(), mask_blur={"sigma": 0.4}, optical_blur={"sigma": 0.3})[0]
    np.testing.assert_allclose(twice, once, atol=3e-3)
