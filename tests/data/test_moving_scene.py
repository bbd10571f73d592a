import math

import numpy as np
import pytest
import torch

from sci_lightning.data.moving_scene import Motion, MovingScene
from sci_lightning.data.photographs import Photograph


def photograph(value, size=(120, 160)):
    """A flat picture, so that its pixels can be told in the rendered frames."""
    return Photograph("flat", tuple(torch.full((size[0] >> k, size[1] >> k), value) for k in range(3)))


@pytest.mark.parametrize("size", [(64, 64), (40, 72), (8, 8)])
def test_shape_type_and_range(size):
    for seed in range(20):
        video = MovingScene([photograph(0.2), photograph(0.9)], np.random.default_rng(seed), size).render(5)
        assert video.shape == (5, *size)
        assert video.dtype == torch.float32
        assert 0 <= video.min() <= video.max() <= 1


def test_objects_move_in_front_of_the_background():
    seen = moved = 0
    for seed in range(40):
        video = MovingScene([photograph(0.2), photograph(0.8)], np.random.default_rng(seed), (64, 64)).render(8)
        background = video.flatten().mode().values
        seen += bool((video - background).abs().max() > 0.05)
        moved += bool(video.diff(dim=0).abs().max() > 0.05)
    assert seen >= 36  # now and then an object is outside, or as bright as what is behind it
    assert moved >= 34


def test_rendering_is_deterministic_and_goes_on_smoothly():
    scene = MovingScene([photograph(0.2), photograph(0.8)], np.random.default_rng(1), (32, 32))
    assert torch.equal(scene.render(4), scene.render(4))
    torch.testing.assert_close(scene.render(12)[:4], scene.render(4))


def test_there_are_no_dark_borders():
    for seed in range(20):
        scene = MovingScene([photograph(0.9), photograph(0.9)], np.random.default_rng(seed), (200, 200))
        assert scene.render(3).min() > 0.5


TIMES = torch.arange(400, dtype=torch.float64)


def make(**arguments):
    still = {"centre": np.array([3.0, -2.0]), "reach": np.zeros(2), "phase": np.zeros(2)}
    return Motion(**{**still, "rate": 0.0, "angle": 0.0, "spin": 0.0, "zoom": 0.0, **arguments})


def test_at_rest_it_only_shifts():
    matrix = make().to_layer(TIMES)
    expected = torch.tensor([[1, 0, -3], [0, 1, 2]], dtype=torch.float64)
    torch.testing.assert_close(matrix, expected.expand(400, 2, 3))


def test_the_centre_of_the_layer_is_where_the_formula_says():
    reach, phase = np.array([5.0, 9.0]), np.array([0.3, 1.0])
    matrix = make(reach=reach, phase=phase, rate=0.2, angle=0.7, spin=0.01, zoom=0.1).to_layer(TIMES)
    centre = np.array([3, -2]) + reach * np.sin(0.2 * TIMES.numpy()[:, None] + phase)
    at_centre = matrix @ torch.from_numpy(np.hstack((centre, np.ones((400, 1)))))[:, :, None]
    torch.testing.assert_close(at_centre, torch.zeros(400, 2, 1, dtype=torch.float64))


def test_turning_and_zooming_scale_areas_only_by_the_zoom():
    turning = make(angle=0.4, spin=0.1).to_layer(TIMES)[:, :, :2]
    torch.testing.assert_close(torch.linalg.det(turning), torch.ones(400, dtype=torch.float64))
    zooming = make(rate=math.pi / 2, zoom=0.1).to_layer(TIMES[:2])[:, :, :2]
    torch.testing.assert_close(torch.linalg.det(zooming)[1].item(), math.exp(-0.2))


def test_drawn_motions_keep_their_bounds():
    for seed in range(50):
        random = np.random.default_rng(seed)
        motion = Motion.draw(random, np.zeros(2), reach=20, speed=3, tilt=0.5, spin=0.05)
        place = motion.reach * np.sin(motion.rate * TIMES.numpy()[:, None] + motion.phase)
        assert np.abs(place).max() <= 20
        assert np.abs(np.diff(place, axis=0)).max() <= 3
        assert abs(motion.angle) <= 0.5
        assert abs(motion.spin) <= 0.05
