"""Masks on the modulator's own grid: nominal images, deviations from them, and what lies beyond."""

from __future__ import annotations

import math
import resource

import numpy as np
import pytest
import torch

from sci_lightning.encoder import Encoder
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import (
    MaskBlur,
    MaskDistortion,
    MaskKeystone,
    MaskOrientation,
    MaskRotation,
    MaskScale,
    MaskShift,
    OpticalBlur,
)
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import LearnedStructural, RandomBinary
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from tests.own_grid_camera import Deviation, homography, image

SIZE, MIRRORS = (20, 24), (33, 40)
HOMOGRAPHIES = {
    "the same pitch": homography((1.0, 1.0), size=SIZE, mirrors=MIRRORS, offset=(0.3, -0.4)),
    "wide mirrors": homography((5.2, 2.6), size=SIZE, mirrors=MIRRORS),
    "small mirrors": homography((0.6, 0.7), size=SIZE, mirrors=MIRRORS),
    "mirrored": homography((1.3, 1.6), size=SIZE, mirrors=MIRRORS, mirrored=True),
    "upside down": homography((1.3, 1.6), 180.0, size=SIZE, mirrors=MIRRORS),
    "a quarter turn": homography((1.3, 1.6), 90.0, size=SIZE, mirrors=MIRRORS),
    "a small turn": homography((1.4, 1.4), 3.0, size=SIZE, mirrors=MIRRORS),
    "a diamond": homography((1.2, 1.2), 45.0, size=SIZE, mirrors=MIRRORS),
    "perspective": homography((1.5, 1.4), 5.0, size=SIZE, mirrors=MIRRORS, tilt=(0.05, -0.08)),
}


@pytest.fixture
def patterns() -> np.ndarray:
    return np.random.default_rng(1).random((2, *MIRRORS))


def seen(patterns: np.ndarray, grid: ModulatorGrid, *effects: torch.nn.Module) -> np.ndarray:
    return np.asarray(LightPath(effects, grid).images(torch.from_numpy(patterns).float()))


@pytest.mark.parametrize("name", HOMOGRAPHIES)
def test_nominal_image(name: str, patterns: np.ndarray) -> None:
    """It is that of rays, to what a lattice of rays is wrong at the corners of mirrors."""
    matrix = HOMOGRAPHIES[name]
    expected = image(patterns, matrix, SIZE)
    error = seen(patterns, ModulatorGrid(matrix, SIZE, MIRRORS)) - expected
    assert np.sqrt((error**2).mean()) < 0.02 * patterns.std() and abs(error).max() < 0.03


@pytest.mark.parametrize(
    ("effects", "deviation"),
    [
        ([MaskShift(dx=1.3, dy=-0.6)], Deviation(shift=(1.3, -0.6))),
        ([MaskRotation(angle=4.0)], Deviation(angle=4.0)),
        ([MaskScale(scale=1.04)], Deviation(scale=1.04)),
        ([MaskKeystone(tilt_x=0.04, tilt_y=-0.03)], Deviation(tilt=(0.04, -0.03))),
        ([MaskDistortion(k=-0.06)], Deviation(barrel=-0.06)),
        (
            [MaskShift(dx=0.5, dy=0.8), MaskRotation(angle=-2.0), MaskDistortion(k=0.05)],
            Deviation(shift=(0.5, 0.8), angle=-2.0, barrel=0.05),
        ),
    ],
    ids=lambda value: "-".join(effect.name for effect in value) if isinstance(value, list) else "",
)
@pytest.mark.parametrize("name", ["wide mirrors", "a small turn"])
def test_deviations_are_in_pixels(
    name: str, effects: list[torch.nn.Module], deviation: Deviation, patterns: np.ndarray
) -> None:
    matrix = HOMOGRAPHIES[name]
    expected = image(patterns, matrix, SIZE, deviation)
    error = seen(patterns, ModulatorGrid(matrix, SIZE, MIRRORS), *effects) - expected
    assert np.sqrt((error**2).mean()) < 0.03 * patterns.std()


@pytest.mark.parametrize("sigma", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("name", ["wide mirrors", "small mirrors", "a small turn", "perspective", "a diamond"])
def test_blur_is_in_pixels(name: str, sigma: float, patterns: np.ndarray) -> None:
    """The image is as blurred as that of rays, whatever the mirrors' pitch; its edges aside, where rays end."""
    matrix, edge = HOMOGRAPHIES[name], math.ceil(2 * sigma)
    blurred = seen(patterns, ModulatorGrid(matrix, SIZE, MIRRORS), MaskBlur(sigma=sigma))
    expected = image(patterns, matrix, SIZE, Deviation(blur=sigma))
    inner = (slice(None), slice(edge, -edge), slice(edge, -edge))
    assert np.sqrt(((blurred - expected)[inner] ** 2).mean()) < 0.02 * patterns.std()


@pytest.mark.parametrize("sigma", [0.7, 1.0, 2.0, 4.0])
def test_blur_spreads_light_beyond_the_modulators_edge_and_back(sigma: float) -> None:
    """A grid that hardly leans is imaged as one that is upright, for which no step of the blur is taken apart."""
    upright = np.array([[2.0, 0, -28.0], [0, 2.0, -12.0], [0, 0, 1]])  # the modulator ends inside the field
    leaning = upright + np.array([[0, 1e-6, 0], [1e-6, 0, 0], [0, 0, 0]])
    size, mirrors = (32, 48), (40, 64)
    images = [
        seen(np.ones((1, *mirrors)), ModulatorGrid(m, size, mirrors), MaskBlur(sigma=sigma)) for m in (upright, leaning)
    ]
    np.testing.assert_allclose(images[1], images[0], atol=3e-3)


@pytest.mark.parametrize("angle", [2.0, 10.0, 34.0, 36.0, 45.0, 80.0])
def test_sharp_mirrors_that_are_turned(angle: float) -> None:
    """A random binary pattern is right to a thousandth of its contrast, whatever the angle; its edges aside."""
    mirrors, size = (24, 24), (12, 12)
    binary = (np.random.default_rng(0).random((2, *mirrors)) < 0.5).astype(np.float32)
    matrix = homography((1.0, 1.0), angle, size, mirrors)
    error = (seen(binary, ModulatorGrid(matrix, size, mirrors)) - image(binary, matrix, size, rays=60))[:, 1:-1, 1:-1]
    assert np.sqrt((error**2).mean()) < 1.1e-3


def test_a_large_field_takes_bounded_memory() -> None:
    """Parts of pixels are computed a few lines at a time; at once, their places alone would take 2 GiB."""
    size = (128, 640)
    grid = ModulatorGrid(homography((1.0, 1.0), 45.0, size, (600, 600)), size, (600, 600))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert seen(np.ones((1, 600, 600)), grid).shape == (1, *size)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 600 * 1024


def test_where_mirrors_are_pixels_nothing_changes(patterns: np.ndarray) -> None:
    mine = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(0))
    grid = ModulatorGrid(np.eye(3), SIZE, SIZE)
    for effects in ([], [MaskShift(dx=0.4, dy=-1.2)], [MaskBlur(sigma=0.8)], [MaskRotation(angle=2.0)]):
        expected = LightPath(effects).images(mine)
        torch.testing.assert_close(LightPath(effects, grid).images(mine), expected, atol=2e-6, rtol=0)


def test_border_is_what_sees_beyond_the_modulator() -> None:
    inside = ModulatorGrid(HOMOGRAPHIES["the same pitch"], SIZE, MIRRORS)
    assert LightPath([], inside).border(SIZE) == Border()
    assert LightPath([MaskShift(dx=3.0, dy=-2.0)], inside).border(SIZE) == Border()
    assert LightPath([MaskShift(dx=12.0, dy=0.0)], inside).border(SIZE).left == 4
    assert LightPath([OpticalBlur(sigma=1.0)], inside).border(SIZE) == Border.of_blur(1.0)
    part = ModulatorGrid(homography((1.0, 1.0), size=SIZE, mirrors=(16, 16)), SIZE, (16, 16))
    assert LightPath([], part).border(SIZE) == Border(2, 4, 2, 4)
    turned = ModulatorGrid(homography((1.0, 1.0), 10.0, size=SIZE, mirrors=(16, 16)), SIZE, (16, 16))
    rows, columns = LightPath([], turned).border(SIZE).window(SIZE)
    whole = image(np.ones((1, 16, 16)), turned.sensor_to_modulator, SIZE)[0]
    assert (whole[rows, columns] > 0.999).all() and whole[rows, columns].size > 60


@pytest.mark.parametrize(
    ("matrix", "mirrors", "message"),
    [
        (np.zeros((3, 3)), (33, 40), "the homography is singular"),
        ([[1, 2, 0], [2, 4, 0], [0, 0, 1]], (33, 40), "the homography is singular"),
        (np.eye(2), (33, 40), "expected 3 x 3 finite numbers"),
        (np.full((3, 3), np.nan), (33, 40), "expected 3 x 3 finite numbers"),
        ([[1, 0, 0], [0, 1, 0], [0.2, 0, -1]], (33, 40), "maps a part of the field to infinity"),
        (
            [[1, 0, 500], [0, 1, 0], [0, 0, 1]],
            (33, 40),
            "maps the field of 20 x 24 pixels off the modulator of 33 x 40",
        ),
        (
            np.eye(3),
            (8, 8),
            "'patterns' of 8 x 8 mirrors are too small for the field.*cover 13.3% of its 20 x 24 pixels",
        ),
        (np.diag([100.0, 100, 1]), (33, 40), "100 mirrors per pixel"),
    ],
)
def test_homographies_that_show_nothing(matrix: object, mirrors: tuple[int, int], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        ModulatorGrid(matrix, SIZE, mirrors)  # type: ignore[arg-type]


def test_encoder_records_what_the_field_sees() -> None:
    matrix = HOMOGRAPHIES["a small turn"].tolist()
    encoder = Encoder(RandomBinary(4, MIRRORS), ClipQuantise(), sensor_to_modulator=matrix, size=SIZE)
    video = torch.rand(2, 4, *SIZE)
    assert encoder.size == SIZE and encoder(video).shape == (2, *SIZE)
    expected = image(encoder.mask().numpy(), np.array(matrix), SIZE)
    assert np.sqrt(((encoder.transmittance().numpy() - expected) ** 2).mean()) < 0.03
    window = encoder.transmittance_window(3, 4, 6, 5)
    assert torch.equal(window, encoder.transmittance()[:, 3:9, 4:9])
    torch.testing.assert_close(
        encoder.record(video[..., 3:9, 4:9], window, (3, 4)), encoder(video)[:, 3:9, 4:9], atol=1 / 255, rtol=0
    )


def test_a_mask_is_learned_through_a_homography() -> None:
    matrix = HOMOGRAPHIES["wide mirrors"].tolist()
    encoder = Encoder(LearnedStructural(2, 4, MIRRORS), ClipQuantise(), sensor_to_modulator=matrix, size=SIZE)
    encoder(torch.rand(1, 4, *SIZE)).square().sum().backward()
    (weight,) = (parameter for parameter in encoder.mask.parameters() if parameter.grad is not None)
    assert weight.grad is not None and weight.grad.abs().sum() > 0


def test_encoder_refuses_half_of_it() -> None:
    mask = RandomBinary(4, MIRRORS)
    with pytest.raises(BadInput, match=r"encoder\.sensor_to_modulator .*encoder\.size="):
        Encoder(mask, ClipQuantise(), sensor_to_modulator=np.eye(3).tolist())
    with pytest.raises(BadInput, match=r"encoder\.size=\[20, 24\].*\[33, 40\]"):
        Encoder(mask, ClipQuantise(), size=SIZE)
    with pytest.raises(BadInput, match="singular"):
        Encoder(mask, ClipQuantise(), sensor_to_modulator=np.zeros((3, 3)).tolist(), size=SIZE)


def test_modulator_effects_act_on_the_mirrors(patterns: np.ndarray) -> None:
    matrix = HOMOGRAPHIES["wide mirrors"]
    flipped = seen(patterns, ModulatorGrid(matrix, SIZE, MIRRORS), MaskOrientation(operation="flip_lr"))
    assert np.abs(flipped - seen(patterns[..., ::-1].copy(), ModulatorGrid(matrix, SIZE, MIRRORS))).max() < 1e-6
