import shutil

import pytest

from sci_lightning.data.davis import Davis
from sci_lightning.errors import BadInput


@pytest.fixture
def make(davis, tmp_path):
    def make_davis(root=davis, **arguments):
        return Davis(root, 4, (32, 40), (16, 16), store=tmp_path / "store", **arguments)

    return make_davis


def test_train_trains_and_val_is_held_out(make):
    source = make()
    assert [clip.name for clip in source.training] == ["bear", "bus", "car"]
    assert [scene.name for scene in source.scenes()] == ["camel", "goat"]
    assert len(source.clips()) == 3 * 2


def test_root_is_the_davis_folder_or_the_one_above(make, davis):
    assert make(davis).training == make(davis / "DAVIS").training


def test_frames_are_stored_at_full_resolution(make):
    assert make().clips().store.shapes == [(9, 40, 48)] * 3


def test_arguments_reach_the_clips(make):
    clips = make(clips_per_epoch=5, seed=3, max_stride=1, rotate=False).clips()
    assert len(clips) == 5
    assert clips.seed == 3
    assert clips.augmentation.max_stride == 1
    assert not clips.augmentation.rotate


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("JPEGImages", "data: neither it nor a folder in it holds JPEGImages/480p"),
        ("ImageSets/2017/train.txt", r"train\.txt: no such file; it lists the train sequences"),
        ("ImageSets/2017/val.txt", r"val\.txt: no such file; it lists the val sequences"),
        ("JPEGImages/480p/goat", r"goat: no such folder, though .*val\.txt lists it"),
    ],
)
def test_missing_parts_are_named(make, davis, missing, message):
    path = davis / "DAVIS" / missing
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(BadInput, match=message):
        make()


def test_an_empty_list_of_sequences_is_named(make, davis):
    (davis / "DAVIS" / "ImageSets" / "2017" / "val.txt").write_text("\n")
    with pytest.raises(BadInput, match=r"val\.txt: is empty"):
        make()


def test_a_sequence_without_frames_is_named(make, davis):
    for frame in (davis / "DAVIS" / "JPEGImages" / "480p" / "bus").iterdir():
        frame.unlink()
    with pytest.raises(BadInput, match="bus: holds no frames"):
        make().clips()


@pytest.mark.parametrize("name", ["../x", "/etc", "..", "a/../../x", "\x1b[2J"])
def test_a_list_of_sequences_leads_nowhere_else(make, davis, name):
    (davis / "DAVIS" / "ImageSets" / "2017" / "val.txt").write_text(f"goat\n{name}\n")
    with pytest.raises(BadInput, match=r"val\.txt: '.*' is no name of a sequence"):
        make()
