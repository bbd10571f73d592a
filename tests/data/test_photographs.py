import pytest
import torch

from sci_lightning.data.photographs import HELD_OUT, TRAINING, load_photographs
from sci_lightning.errors import BadInput


def test_no_picture_is_used_for_both_training_and_testing():
    assert not set(TRAINING) & set(HELD_OUT)


@pytest.mark.parametrize("name", TRAINING + HELD_OUT)
def test_every_photograph_is_bundled(name):
    (photograph,) = load_photographs((name,))
    assert name.startswith(photograph.name)
    assert [level.dtype for level in photograph.levels] == [torch.float32] * 3
    for level in photograph.levels:
        assert 0 <= level.min() < level.max() <= 1
    assert photograph.levels[0].std() > 0.02


@pytest.mark.parametrize(("scale", "level", "step"), [(0.5, 0, 0.5), (1, 0, 1), (2, 1, 1), (4, 2, 1), (12, 2, 3)])
def test_the_level_fits_the_scale(scale, level, step):
    (camera,) = load_photographs(("camera.png",))
    texture, result = camera.level(scale)
    assert texture is camera.levels[level]
    assert result == step


def test_a_photograph_that_is_not_installed_is_named():
    with pytest.raises(BadInput, match=r"lena\.png: missing; reinstall scikit-image"):
        load_photographs(("lena.png",))
