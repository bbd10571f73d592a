import h5py
import numpy as np
import pytest
import torch
from scipy.io import savemat

from sci_lightning.data.folder import Folder
from sci_lightning.errors import BadInput


@pytest.fixture
def make(tree, tmp_path):
    def make_folder(root=tree, **arguments):
        return Folder(root, 4, (32, 40), (16, 16), store=tmp_path / "store", **arguments)

    return make_folder


def test_a_share_is_held_out_whatever_the_seed(make):
    """Else a test with another seed would fall on clips that were trained on."""
    first, second = (make(seed=seed, validation=0.4) for seed in (0, 1))
    assert first.held_out == second.held_out and first.training == second.training
    assert len(first.held_out) == 2 and len(first.training) == 3
    assert not set(first.training) & set(first.held_out)


@pytest.mark.parametrize(("share", "held_out"), [(0.01, 1), (0.5, 2), (0.99, 4)])
def test_at_least_one_clip_is_on_either_side(make, share, held_out):
    assert len(make(validation=share).held_out) == held_out


def test_val_root_is_held_out_whole(make, tree, tmp_path, noise):
    other = tmp_path / "val"
    other.mkdir()
    np.savez(other / "held.npz", frames=noise(9))
    folder = make(val_root=other)
    assert len(folder.training) == 5
    assert [scene.name for scene in folder.scenes()] == ["held"]


def test_val_root_inside_root_is_not_trained_on(make, tree):
    folder = make(val_root=tree / "clip3.npz")
    assert [clip.name for clip in folder.training] == ["clip0.npz", "clip1.npz", "clip2.npz", "clip4.npz"]
    with pytest.raises(BadInput, match=r"val_root=.* none is left"):
        make(val_root=tree).clips()


def test_arguments_reach_the_clips(make):
    folder = make(clips_per_epoch=3, max_stride=1, reverse=False, scale=(1, 1), flip=False, rotate=False)
    assert len(folder.clips()) == 3
    assert vars(folder.clips().augmentation) == {
        "frames": 4,
        "height": 16,
        "width": 16,
        "max_stride": 1,
        "reverse": False,
        "smallest": 1,
        "largest": 1,
        "flip": False,
        "rotate": False,
    }


def test_a_single_clip_asks_for_val_root(make, tree):
    single = make(tree / "clip0.npz")
    assert [scene.name for scene in single.scenes()] == ["clip0"]  # it can be tested on
    with pytest.raises(BadInput, match=r"clip0\.npz: .*single.*val_root"):
        single.clips()


def test_matlab_and_hdf5_files_with_frames_are_clips(make, tree, noise):
    for number, name in enumerate(("lab.mat", "mask.mat", "lab.h5", "other.h5")):
        key = "mask" if number % 2 else "orig"
        if name.endswith(".mat"):
            savemat(tree / name, {key: np.moveaxis(noise(16), 0, -1), "meas": noise(1)[0]})
        else:
            with h5py.File(tree / name, "w") as file:
                file[key] = noise(16)
    every = make(val_root=tree)
    names = [clip.name for clip in every.held_out]
    assert "lab.mat" in names and "lab.h5" in names and not {"mask.mat", "other.h5"} & set(names)
    videos = {clip.name: scene.video[0] for clip, scene in zip(every.held_out, every.scenes(), strict=True)}
    assert torch.equal(videos["lab.mat"], videos["lab.h5"])


@pytest.mark.parametrize("share", [0, 1, -0.1, 2])
def test_validation_must_be_a_share(make, share):
    with pytest.raises(BadInput, match=rf"validation={share}: must lie between 0 and 1"):
        make(validation=share)


def test_missing_roots_are_named(make, tmp_path):
    with pytest.raises(BadInput, match="absent: no such file or folder"):
        make(tmp_path / "absent")
    with pytest.raises(BadInput, match="absent: no such file or folder"):
        make(val_root=tmp_path / "absent")


def test_a_nan_clip_is_named_before_training(make, tree):
    np.savez(tree / "nan.npz", frames=np.full((8, 40, 48), np.nan))
    with pytest.raises(BadInput, match=r"nan\.npz, frame 0: values from nan to nan"):
        make(val_root=tree / "clip0.npz").clips()


def test_real_clips(shared, tmp_path):
    folder = Folder(
        shared / "train", 8, (256, 256), (128, 128), val_root=shared / "val", store=tmp_path, clips_per_epoch=100
    )
    scenes = folder.scenes()
    assert [scene.name for scene in scenes] == [
        "davis-camel",
        "davis-kite-surf",
        "davis-rollercoaster",
        "davis-scooter-black",
        "vid4-city",
    ]
    assert [len(scene.video) for scene in scenes] == [4, 4, 4, 4, 3]
    folder.training = folder.training[:3]
    clips = folder.clips()
    assert all(clips[i].shape == (8, 128, 128) for i in range(10))
