import numpy as np
import pytest
import torch

from sci_lightning.data.augmentation import Augmentation
from sci_lightning.data.reader import find_clips
from sci_lightning.data.store import ClipStore
from sci_lightning.data.stored_clips import StoredClips, stored_scenes
from sci_lightning.errors import BadInput


@pytest.fixture
def store(tree, tmp_path):
    return ClipStore(find_clips(tree), tmp_path / "store")


def test_an_epoch_is_as_long_as_there_are_groups_of_frames(store):
    assert len(StoredClips(store, Augmentation(4, (16, 16)))) == 3 * 4 + 4  # of 12, 13, 14, 15, 16 frames
    assert len(StoredClips(store, Augmentation(4, (16, 16)), clips_per_epoch=7)) == 7


def test_indices_never_end_but_start_at_zero(store):
    clips = StoredClips(store, Augmentation(4, (16, 16)))
    assert clips[10**12].shape == (4, 16, 16)
    with pytest.raises(IndexError, match="starts at 0"):
        clips[-1]


def test_the_seed_decides(store):
    augmentation = Augmentation(4, (16, 16))
    assert not torch.equal(StoredClips(store, augmentation)[3], StoredClips(store, augmentation, seed=1)[3])


def test_longer_clips_are_drawn_more_often(tmp_path):
    np.savez(tmp_path / "long.npz", frames=np.full((30, 16, 16), 200, np.uint8))
    np.savez(tmp_path / "short.npz", frames=np.zeros((10, 16, 16), np.uint8))
    store = ClipStore(find_clips(tmp_path), tmp_path / "store")
    clips = StoredClips(store, Augmentation(5, (8, 8)))
    assert 0.65 < np.mean([clips[i].mean() > 0 for i in range(400)]) < 0.85


def test_clips_too_short_or_too_small_are_named_at_once(store):
    with pytest.raises(BadInput, match=r"clip0\.npz: has 12 frames; .* 13"):
        StoredClips(store, Augmentation(13, (16, 16)))
    with pytest.raises(BadInput, match=r"clip0\.npz: has 40 x 48 .* 48 x 48"):
        StoredClips(store, Augmentation(4, (64, 64)))
    with pytest.raises(BadInput, match="clips_per_epoch=0: must be at least 1"):
        StoredClips(store, Augmentation(4, (16, 16)), clips_per_epoch=0)


def test_scenes_are_centres_in_whole_groups(store, noise):
    scenes = stored_scenes(store, 5, (30, 32))
    assert [scene.name for scene in scenes] == [f"clip{i}" for i in range(5)]
    assert [len(scene.video) for scene in scenes] == [2, 2, 2, 3, 3]
    expected = torch.from_numpy(noise(13, seed=1)[:10, 5:35, 8:40]) / 255
    assert torch.equal(torch.stack(list(scenes[1].video)), expected.reshape(2, 5, 30, 32))


def test_scenes_that_share_a_name_are_told_apart(tmp_path, noise):
    for name in ("one/frames.npz", "two/frames.npz", "two/other.npz", "two/frames"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        np.savez(tmp_path / f"{name.removesuffix('.npz')}.npz", frames=noise())
    (tmp_path / "three" / "v1.5").mkdir(parents=True)
    (tmp_path / "two" / "frames.npz").rename(tmp_path / "three" / "frames.npz")
    store = ClipStore(find_clips(tmp_path), tmp_path / "store")
    names = [scene.name for scene in stored_scenes(store, 4, (8, 8))]
    assert names == ["one-frames.npz", "three-frames.npz", "other"]


def test_clips_that_make_no_scene_are_named(store):
    with pytest.raises(BadInput, match=r"clip0\.npz: 12 frames of 40 x 48 .* 13 .* 8 x 8"):
        stored_scenes(store, 13, (8, 8))
    with pytest.raises(BadInput, match=r"clip0\.npz: .* 4 .* 41 x 8"):
        stored_scenes(store, 4, (41, 8))
