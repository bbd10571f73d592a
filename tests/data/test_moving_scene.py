import numpy as np
import pytest
import torch

from sci_lightning.data.moving_scene import MovingScene
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
