from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.data.folder import Folder
from sci_lightning.data.photographs import HELD_OUT, TRAINING, load_photographs, read_photographs
from sci_lightning.data.synthetic import Synthetic, SyntheticClips
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


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path, random = tmp_path / "photographs.npz", np.random.default_rng(0)
    np.savez_compressed(path, **{name: random.integers(0, 256, (80, 100), np.uint8) for name in ("one", "two")})
    return path


def test_photographs_of_a_file_make_clips_with_motion_blur(file: Path) -> None:
    assert [photograph.name for photograph in read_photographs(file)] == ["one", "two"]
    source = Synthetic(4, (32, 32), (24, 24), photographs=file)
    clip = source.clips()[5]
    assert clip.shape == (4, 24, 24) and clip.min() >= 0 and clip.max() <= 1
    assert torch.equal(clip, Synthetic(4, (32, 32), (24, 24), photographs=file).clips()[5])
    sharp = SyntheticClips(read_photographs(file), 4, (24, 24), 0, 10)[5]
    assert clip.diff(dim=-1).abs().mean() < sharp.diff(dim=-1).abs().mean()
    assert [scene.name for scene in source.scenes()][:2] == ["camera", "coffee"]  # held-out scenes are the usual ones


def test_a_part_of_a_folders_clips_is_made_of_photographs(file: Path, tmp_path: Path) -> None:
    roots = [tmp_path / name for name in ("a", "b")]
    for root in roots:
        root.mkdir()
        for number in range(2):
            np.savez(root / f"{number}.npz", frames=np.full((8, 40, 40), 255, np.uint8))
    settings = {"root": roots, "store": tmp_path / "store", "photographs": file, "clips_per_epoch": 40}
    source = Folder(frames=4, size=(32, 32), crop=(24, 24), scale=(1, 1), **settings)
    assert len(source.training) + len(source.held_out) == 4
    clips = source.clips()
    made = sum(not torch.equal(clips[index], torch.ones(4, 24, 24)) for index in range(len(clips)))
    assert len(clips) == 40 and 3 <= made <= 20  # a quarter, by default
    with pytest.raises(IndexError, match="starts at 0"):
        clips[-1]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"one": np.zeros((80, 80), np.uint8)}, "two or more photographs"),
        ({"one": np.zeros((80, 80), np.uint8), "two": np.zeros((80, 80))}, "'two' is float64"),
        ({"one": np.zeros((80, 80), np.uint8), "two": np.zeros((80, 8), np.uint8)}, r"'two' .*\(80, 8\); .*64 x 64"),
    ],
)
def test_what_is_no_file_of_photographs(arrays: dict[str, np.ndarray], message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(BadInput, match=message) as caught:
        read_photographs(tmp_path / "bad.npz")
    assert str(caught.value).startswith(f"{tmp_path / 'bad.npz'}: ") and "\n" not in str(caught.value)


def test_a_damaged_file_of_photographs(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[200:240] = bytes(40)
    file.write_bytes(content)
    for path in (file, file.with_name("none.npz"), file.parent):
        with pytest.raises(BadInput, match=path.name):
            read_photographs(path)
