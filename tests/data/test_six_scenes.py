import h5py
import numpy as np
import pytest
import torch
from scipy.io import savemat

from sci_lightning.data.six_scenes import LENGTHS, SixScenes
from sci_lightning.errors import BadInput, InputWarning


@pytest.fixture
def save(tmp_path, noise):
    def save_scene(name, frames, seed=0, key="orig"):
        savemat(tmp_path / f"{name}.mat", {key: np.moveaxis(noise(frames, 8, 10, seed), 0, -1)})

    return save_scene


@pytest.fixture
def make(tmp_path):
    def make_source(*scenes, frames=8, size=(8, 10)):
        return SixScenes(tmp_path, frames, size, scenes=scenes or tuple(LENGTHS))

    return make_source


@pytest.fixture
def all_scenes(save):
    for name, frames in LENGTHS.items():
        save(f"{name}_cacti", frames)


def test_scenes_come_in_the_papers_order_and_length(make, all_scenes):
    scenes = make().scenes()
    assert [scene.name for scene in scenes] == ["kobe", "traffic", "runner", "drop", "crash", "aerial"]
    assert [len(scene.video) for scene in scenes] == [4, 6, 1, 1, 4, 4]


def test_values_are_divided_by_255(make, all_scenes, noise):
    (kobe,) = make("kobe").scenes()
    assert kobe.video.dtype == torch.float32
    assert torch.equal(kobe.video, (torch.from_numpy(noise(32, 8, 10)) / 255).reshape(4, 8, 8, 10))


def test_frames_beyond_whole_groups_are_dropped(make, all_scenes, noise):
    kobe, traffic = make("kobe", "traffic", frames=10).scenes()
    assert (len(kobe.video), len(traffic.video)) == (3, 4)
    assert torch.equal(kobe.video[2, 9], torch.from_numpy(noise(32, 8, 10)[29]) / 255)


@pytest.mark.parametrize(
    ("scene", "file"),
    [
        ("kobe", "kobe"),
        ("kobe", "kobe_cacti"),
        ("kobe", "kobe32_cacti"),
        ("kobe", "kobe32_u8_rebuilt"),
        ("kobe", "Kobe32"),
        ("crash", "crash32_cacti"),
        ("crash", "vehicle32_cacti"),
        ("crash", "vehicle"),
        ("aerial", "aerial32_cacti"),
    ],
)
def test_usual_file_names_are_known(make, save, scene, file):
    save(file, 32)
    assert len(make(scene).scenes()[0].video) == 4


def test_a_longer_file_gives_its_first_frames(make, save, noise):
    save("runner40_cacti", 40)
    (runner,) = make("runner").scenes()
    assert torch.equal(runner.video[0], torch.from_numpy(noise(40, 8, 10)[:8]) / 255)


def test_originals_come_before_others_but_after_none_that_are_too_short(make, save, noise):
    save("kobe32_a_rebuilt", 32, seed=1)
    save("kobe8_cacti", 8, seed=2)
    assert torch.equal(make("kobe").scenes()[0].video[0, 0], torch.from_numpy(noise(32, 8, 10, 1)[0]) / 255)
    save("kobe_cacti", 32, seed=3)
    assert torch.equal(make("kobe").scenes()[0].video[0, 0], torch.from_numpy(noise(32, 8, 10, 3)[0]) / 255)


def test_files_that_are_all_too_short_are_named(make, save):
    save("kobe8_cacti", 8)
    save("kobe31_cacti", 31)
    with pytest.raises(BadInput, match=r"kobe .*32 .*kobe31_cacti\.mat .*31, kobe8_cacti\.mat .*8"):
        make("kobe").scenes()


def test_missing_scenes_are_named_with_what_is_left(make, save):
    save("kobe_cacti", 32)
    save("dropped_frames", 8)  # is not the scene "drop"
    save("traffic_cacti", 48)
    with pytest.raises(BadInput, match=r"drop, crash: no file .*=\[kobe,traffic\]"):
        make("kobe", "drop", "crash", "traffic")
    with pytest.raises(BadInput, match=r"drop: .*drop_cacti\.mat or drop\.mat$"):
        make("drop")


def test_scenes_shorter_than_a_snapshot_are_named(make, all_scenes):
    with pytest.raises(
        BadInput,
        match=r"runner, drop: .* 10 .*=\[kobe,traffic,crash,aerial\]'",
    ):
        make(frames=10)


def test_another_size_is_refused_not_resized(make, all_scenes):
    with pytest.raises(BadInput, match=r"kobe_cacti\.mat: .*\(8, 10\).*\(10, 8\)"):
        make("kobe", size=(10, 8)).scenes()


def test_a_missing_key_is_named(make, save):
    save("kobe_cacti", 32, key="video")
    with pytest.raises(BadInput, match=r"kobe_cacti\.mat: .*'orig'; .*video"):
        make("kobe").scenes()


def test_unknown_scenes_and_folders_are_named(make, tmp_path):
    with pytest.raises(BadInput, match=r"lena: .*lena\.mat.* kobe, traffic"):
        make("lena")
    with pytest.raises(BadInput, match="absent: no such folder"):
        SixScenes(tmp_path / "absent", 8, (8, 10))


def test_scenes_of_your_own(make, save, tmp_path, noise):
    save("lab01", 19)
    np.savez(tmp_path / "lab02.npz", orig=noise(8, 8, 10), mask=noise(8, 8, 10), meas=noise(1, 8, 10)[0])
    with h5py.File(tmp_path / "lab03.h5", "w") as file:
        file["orig"] = noise(16, 8, 10) / 255
    scenes = make("lab01", "lab02", "lab03").scenes()
    assert [(scene.name, len(scene.video)) for scene in scenes] == [("lab01", 2), ("lab02", 1), ("lab03", 2)]
    for scene in scenes:
        assert scene.video[0].min() >= 0 and 0.9 < scene.video[0].max() <= 1
    assert torch.equal(scenes[1].video[0], torch.from_numpy(noise(8, 8, 10)) / 255)
    with pytest.raises(BadInput, match=r"lab07: .*lab07\.mat.* lab01, lab02, lab03"):
        make("lab07")
    with pytest.raises(BadInput, match="lab02 needs 10 frames"):
        make("lab02", frames=10).scenes()


def test_a_scene_with_time_first(make, tmp_path):
    frames = np.random.default_rng(0).integers(0, 255, (8, 32, 40)).astype(np.uint8)
    savemat(tmp_path / "lab01.mat", {"orig": frames})
    with pytest.warns(InputWarning, match="8 x 32 x 40"):
        (scene,) = make("lab01", size=(32, 40)).scenes()
    assert torch.equal(scene.video[0], torch.from_numpy(frames) / 255)


def test_it_is_for_testing_only(make, all_scenes):
    with pytest.raises(BadInput, match="for testing only"):
        make().clips()


def test_the_real_files(shared):
    scenes = SixScenes(shared / "benchmark", 8, (256, 256)).scenes()
    assert {scene.name: len(scene.video) for scene in scenes} == {
        "kobe": 4,
        "traffic": 6,
        "runner": 1,
        "drop": 1,
        "crash": 4,
        "aerial": 4,
    }
    for scene in scenes:
        assert scene.video.shape[1:] == (8, 256, 256)
        assert 0 <= scene.video.min() < 0.2
        assert 0.8 < scene.video.max() <= 1


def test_the_name_of_the_papers(configuration):
    """``data=benchmark`` is ``data=six_scenes``."""
    former, present = (
        configuration("evaluate", f"data={name}", "data.root=R").data for name in ("benchmark", "six_scenes")
    )
    assert former == present
