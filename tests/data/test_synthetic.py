import numpy as np
import pytest
import torch

from sci_lightning.data.synthetic import Synthetic
from sci_lightning.errors import BadInput


def test_clips_have_the_crops_size_and_scenes_the_masks():
    source = Synthetic(6, (48, 64), (24, 32), clips_per_epoch=7, scenes_count=2, snapshots_per_scene=3)
    assert len(source.clips()) == 7
    assert source.clips()[10**9].shape == (6, 24, 32)
    assert [scene.video.shape for scene in source.scenes()] == [(3, 6, 48, 64)] * 2


def test_scenes_are_named_after_their_background():
    source = Synthetic(2, (16, 16), (16, 16), scenes_count=6, snapshots_per_scene=1)
    names = [scene.name for scene in source.scenes()]
    assert names == ["camera", "coffee", "coins", "gravel", "camera_2", "coffee_2"]


def test_scenes_move_continuously_from_snapshot_to_snapshot():
    for scene in Synthetic(8, (64, 64), (64, 64)).scenes():
        change = scene.video.flatten(0, 1).diff(dim=0).abs().mean((1, 2))
        assert change[7] < 2 * change.median() + 0.01


def test_motion_is_of_a_natural_strength():
    clips = Synthetic(8, (256, 256), (128, 128)).clips()
    change = [255 * clips[i].diff(dim=0).abs().mean().item() for i in range(40)]
    assert 3 < np.median(change) < 15  # real clips: 0.7 to 37 DN, half of them above 12
    assert np.quantile(change, 0.9) < 30


def test_the_seed_decides_what_is_trained_on():
    first, second = (Synthetic(2, (16, 16), (16, 16), seed=seed) for seed in (0, 1))
    assert not torch.equal(first.clips()[0], second.clips()[0])
    assert torch.equal(first.scenes()[0].video, second.scenes()[0].video)  # what two seeds reach can be compared


def test_indices_start_at_zero():
    with pytest.raises(IndexError, match="starts at 0"):
        Synthetic(2, (16, 16), (16, 16)).clips()[-1]


@pytest.mark.parametrize("argument", ["frames", "clips_per_epoch", "scenes_count", "snapshots_per_scene"])
def test_arguments_below_one_are_refused(argument):
    arguments = {"frames": 2, argument: 0}
    with pytest.raises(BadInput, match=rf"{argument}=0.*must be at least 1"):
        Synthetic(size=(16, 16), crop=(16, 16), **arguments)
