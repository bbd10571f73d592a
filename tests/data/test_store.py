import multiprocessing
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from sci_lightning.data import store as store_module
from sci_lightning.data.reader import find_clips, read_frames
from sci_lightning.data.store import ClipStore
from sci_lightning.errors import BadInput, MachineFailure
from tests.conftest import ROOT


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "store"


@pytest.fixture
def decoded(monkeypatch):
    """The names of the clips that are decoded from now on."""
    names = []

    def spy(path, colour=False):
        names.append(path.name)
        return read_frames(path, colour)

    monkeypatch.setattr("sci_lightning.data.store.read_frames", spy)
    return names


def test_clips_are_what_was_read(tree, folder, noise):
    store = ClipStore(find_clips(tree), folder)
    assert len(store) == 5
    assert store.shapes == [(12 + i, 40, 48) for i in range(5)]
    for i in range(5):
        assert store[i].dtype == np.uint8
        assert not store[i].flags.writeable
        np.testing.assert_array_equal(store[i], noise(12 + i, seed=i))


def test_stored_files_are_ordinary_npy_files(tree, folder, noise):
    ClipStore([tree / "clip0.npz"], folder)
    (file,) = folder.iterdir()
    np.testing.assert_array_equal(np.load(file, allow_pickle=False), noise(12))


def test_each_clip_is_decoded_once(tree, folder, decoded):
    clips = find_clips(tree)
    ClipStore(clips, folder)
    ClipStore(clips, folder)
    assert decoded == [clip.name for clip in clips]


def test_an_interrupted_fill_is_taken_up_again(tree, folder, decoded, monkeypatch):
    clips, replace = find_clips(tree), os.replace

    def stop_at_the_third(temporary, file):
        if len(decoded) == 3:
            raise KeyboardInterrupt
        replace(temporary, file)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(os, "replace", stop_at_the_third)
        ClipStore(clips, folder)
    assert len(list(folder.iterdir())) == 2  # and nothing half-done beside them
    (folder / ".0123.tmp").write_bytes(b"left by a process that was killed")
    decoded.clear()
    ClipStore(clips, folder)
    assert decoded == ["clip2.npz", "clip3.npz", "clip4.npz"]


def test_missing_truncated_and_foreign_files_are_made_again(tree, folder, decoded, noise):
    clips = find_clips(tree)
    lost, short, foreign, *_ = ClipStore(clips, folder)._files
    lost.unlink()
    short.write_bytes(short.read_bytes()[:-1])
    np.save(foreign, np.zeros((3, 4)))
    decoded.clear()
    store = ClipStore(clips, folder)
    assert decoded == ["clip0.npz", "clip1.npz", "clip2.npz"]
    for i in range(3):
        np.testing.assert_array_equal(store[i], noise(12 + i, seed=i))


def test_a_changed_source_is_decoded_again(tree, folder, decoded, noise):
    clips = find_clips(tree)
    ClipStore(clips, folder)
    decoded.clear()
    np.savez(clips[1], frames=noise(20, seed=9))
    os.utime(clips[3], ns=(1, 1))
    store = ClipStore(clips, folder)
    assert decoded == ["clip1.npz", "clip3.npz"]
    np.testing.assert_array_equal(store[1], noise(20, seed=9))


def test_one_changed_frame_of_a_folder_is_noticed(davis, folder, decoded):
    bear = davis / "DAVIS" / "JPEGImages" / "480p" / "bear"
    before = ClipStore([bear], folder)[0].copy()
    (bear / "00001.jpg").write_bytes((bear / "00002.jpg").read_bytes())
    after = ClipStore([bear], folder)[0]
    assert decoded == ["bear", "bear"]
    np.testing.assert_array_equal(after[1], before[2])


def test_processes_may_fill_one_store_together(tree, folder, noise):
    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=ClipStore, args=(find_clips(tree), folder)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert len(list(folder.iterdir())) == 5
    np.testing.assert_array_equal(ClipStore(find_clips(tree), folder)[4], noise(16, seed=4))


def test_few_maps_stay_open_and_none_is_pickled(tree, folder):
    store = ClipStore(find_clips(tree), folder, open_maps=2)
    first = store[0]
    assert store[0] is first
    assert store[1] is not store[2]
    assert store[0] is not first  # closed for the sake of the other two
    packed = pickle.dumps(store)
    assert len(packed) < 5000
    np.testing.assert_array_equal(pickle.loads(packed)[3], store[3])


def test_progress_is_shown_only_for_work_and_only_once(tree, folder, capsys, monkeypatch):
    clips = find_clips(tree)
    monkeypatch.setenv("LOCAL_RANK", "1")
    ClipStore(clips[:1], folder)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setenv("LOCAL_RANK", "0")
    ClipStore(clips, folder)
    out, err = capsys.readouterr()
    assert out == ""
    assert "Storing clips" in err
    ClipStore(clips, folder)
    assert capsys.readouterr() == ("", "")


def test_the_default_folder_is_in_the_users_cache(tree, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    ClipStore([tree / "clip0.npz"])
    assert len(list((tmp_path / "cache" / "sci_lightning" / "clips").iterdir())) == 1
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    ClipStore([tree / "clip0.npz"])
    assert len(list((tmp_path / "home" / ".cache" / "sci_lightning" / "clips").iterdir())) == 1


def test_an_unreadable_clip_is_named_and_leaves_nothing(tmp_path, folder):
    np.savez(tmp_path / "nan.npz", frames=np.full((2, 4, 5), np.nan))
    with pytest.raises(BadInput, match=r"nan\.npz, frame 0: values from nan"):
        ClipStore([tmp_path / "nan.npz"], folder)
    assert list(folder.iterdir()) == []
    with pytest.raises(BadInput, match=r"absent\.npz: cannot be read"):
        ClipStore([tmp_path / "absent.npz"], folder)


def test_a_store_that_cannot_be_written_is_named(tree, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=r"file/store: cannot store clips"):
        ClipStore(find_clips(tree), tmp_path / "file" / "store")

    def disk_full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", disk_full)
    with pytest.raises(MachineFailure, match=r"store/\w+\.npy: no space left on device"):
        ClipStore(find_clips(tree), tmp_path / "store")
    assert list((tmp_path / "store").iterdir()) == []


@pytest.mark.parametrize("place", [0, 8, 20, 60, 127, 128, 20_000, -17, -12, -1])
def test_damage_is_found_and_repaired(tree, folder, decoded, noise, capsys, place):
    """Header, shape, pixels, checksums: a flipped bit anywhere costs one more decoding and never a wrong pixel."""
    clip = tree / "clip0.npz"
    (file,) = ClipStore([clip], folder)._files
    content = bytearray(file.read_bytes())
    content[place] ^= 1
    file.write_bytes(content)
    decoded.clear()
    capsys.readouterr()
    np.testing.assert_array_equal(ClipStore([clip], folder)[0], noise(12))
    assert decoded == ["clip0.npz"]
    assert f"{file}: damaged, {clip} is decoded anew\n" in capsys.readouterr().err
    np.testing.assert_array_equal(ClipStore([clip], folder)[0], noise(12))
    assert decoded == ["clip0.npz"]


def test_a_header_that_lies_consistently(tree, folder, noise):
    """Rows and columns changed places: the file has the right length."""
    clip = tree / "clip0.npz"
    (file,) = ClipStore([clip], folder)._files
    file.write_bytes(file.read_bytes().replace(b"(12, 40, 48)", b"(12, 48, 40)"))
    store = ClipStore([clip], folder)
    assert store.shapes == [(12, 40, 48)]
    np.testing.assert_array_equal(store[0], noise(12))


def test_a_page_of_zeros(tree, folder, decoded, noise, capsys):
    clips = find_clips(tree)
    torn, *_ = ClipStore(clips, folder)._files
    with torn.open("r+b") as stream:
        stream.seek(4096)
        stream.write(bytes(4096))
    decoded.clear()
    capsys.readouterr()
    store = ClipStore(clips, folder)
    np.testing.assert_array_equal(store[0], noise(12))
    assert decoded == ["clip0.npz"] and "damaged" in capsys.readouterr().err


def test_pixels_are_verified_once_in_a_process(tree, folder, monkeypatch):
    clips = find_clips(tree)
    ClipStore(clips, folder)
    verified = []
    original = store_module._checksum
    monkeypatch.setattr(store_module, "_checksum", lambda *clip: (verified.append(clip[0]), original(*clip))[1])
    store = ClipStore(clips, folder, open_maps=1)
    assert verified == []  # starting costs nothing
    for index in (0, 1, 0, 1):
        store[index]
    assert len(verified) == 2


def test_a_clip_that_changes_under_a_damaged_store(tree, folder, noise):
    clip = tree / "clip0.npz"
    store = ClipStore([clip], folder)
    store._files[0].write_bytes(b"damaged")
    np.savez(clip, frames=noise(20))
    with pytest.raises(BadInput, match=r"clip0\.npz: changed .*\(12, 40, 48\) to \(20, 40, 48\)"):
        store[0]


def test_what_a_killed_process_left_is_removed(tree, folder):
    clip = tree / "clip0.npz"
    code = (
        "import os, signal, sys; from sci_lightning.data import store\n"
        "store.os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "store.ClipStore([store.Path(sys.argv[1])], sys.argv[2])"
    )
    subprocess.run([sys.executable, "-c", code, clip, folder], cwd=ROOT, capture_output=True, check=False)
    assert len(list(folder.iterdir())) == 1
    (file,) = ClipStore([clip], folder)._files
    assert list(folder.iterdir()) == [file]
