"""A file is whole or absent, whatever happens to its writer or to the disk."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import save_file

from sci_lightning.captures import read_captures, write_captures
from sci_lightning.cli.failure_line import exit_status, one_line
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.files.atomic_file import ABANDONED_AFTER, atomic_write
from tests.captures.conftest import write
from tests.conftest import ROOT
from tests.training.small_training import TINY

Command = Callable[..., subprocess.CompletedProcess[str]]

LARGE = torch.rand(200_000)
WRITERS: dict[str, Callable[[Path], object]] = {
    "text": lambda path: path.write_text("a" * 10**6),
    "array": lambda path: np.save(path.with_name(path.name), LARGE.numpy()),
    "torch": lambda path: torch.save({"a": LARGE}, path),
    "safetensors": lambda path: save_file({"a": LARGE}, path),
    "picture": lambda path: Image.fromarray(np.random.default_rng(0).integers(0, 256, (900, 900), np.uint8)).save(path),
}


@contextmanager
def nearly_full_disk(room: int) -> Iterator[None]:
    """As if there were room for files of so many bytes: the system's limit for a file, which needs no privilege."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("writer", WRITERS)
def test_full_disk(tmp_path: Path, writer: str) -> None:
    path = tmp_path / ("a.npy" if writer == "array" else "a.png" if writer == "picture" else "a.bin")
    path.write_text("before")
    with pytest.raises(MachineFailure) as caught, nearly_full_disk(100_000), atomic_write(path) as temporary:
        WRITERS[writer](temporary)
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and "free some space or write to another disk" in line and "\n" not in line
    assert (one_line(caught.value), exit_status(caught.value)) == (line, 1)
    assert path.read_text() == "before" and os.listdir(tmp_path) == [path.name]


def test_what_libraries_make_of_a_full_disk(tmp_path: Path) -> None:
    """Errors that only carry the system's text, or another error that does."""
    for error in (OSError(errno.ENOSPC, "No space left on device"), OSError(errno.EDQUOT, "Disk quota exceeded")):
        said = r"a\.txt: (no space left on device|disk quota exceeded); free some"
        with pytest.raises(MachineFailure, match=said), atomic_write(tmp_path / "a.txt"):
            raise error
        assert exit_status(error) == 1 and "free some space" in one_line(error)
    with pytest.raises(MachineFailure, match=r"a\.txt: no space left on device"), atomic_write(tmp_path / "a.txt"):
        raise RuntimeError(
            "Can't write data (file write failed: errno = 28, error message = 'No space left on device')"
        )
    with pytest.raises(ZeroDivisionError), atomic_write(tmp_path / "a.txt"):
        raise ZeroDivisionError
    assert os.listdir(tmp_path) == []
    assert exit_status(OSError(errno.EACCES, "Permission denied", "a.txt")) == 2


@pytest.mark.parametrize("room", [0, 1000, 6000])
def test_full_disk_while_captures_are_written(tmp_path: Path, room: int) -> None:
    """HDF5 that meets a full disk itself ends the process with a segmentation fault."""
    captures = read_captures(write(tmp_path / "captures.h5"))
    before = (tmp_path / "captures.h5").read_bytes()
    with pytest.raises(MachineFailure, match=r"captures\.h5: file too large"), nearly_full_disk(room):
        write_captures(tmp_path / "captures.h5", captures)
    assert (tmp_path / "captures.h5").read_bytes() == before and os.listdir(tmp_path) == ["captures.h5"]


@pytest.mark.parametrize(
    ("path", "reason"),
    [("file/a.txt", "no file can be written there"), ("a" * 300 + ".txt", "name too long"), ("folder", "is a folder")],
)
def test_where_no_file_can_be(tmp_path: Path, path: str, reason: str) -> None:
    (tmp_path / "file").write_text("before")
    (tmp_path / "folder").mkdir()
    with pytest.raises(BadInput, match=reason) as caught, atomic_write(tmp_path / path):
        pytest.fail("the writer had begun")
    assert str(caught.value).startswith(str(tmp_path / path)) and "\n" not in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"] and (tmp_path / "file").read_text() == "before"


def test_a_folder_that_is_read_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "touch", denied)
    said = r"a\.txt: no file can be written there \(permission denied\); give another"
    with pytest.raises(BadInput, match=said), atomic_write(tmp_path / "a.txt"):
        pytest.fail("the writer had begun")


@pytest.mark.parametrize("name", ["a" * 251 + ".txt", "ä" * 120 + ".npy", "a." + "b" * 200, "x[1]*.txt"])
def test_long_and_strange_names(tmp_path: Path, name: str) -> None:
    for text in ("first", "second"):
        with atomic_write(tmp_path / name) as temporary:
            temporary.write_text(text)
    assert os.listdir(tmp_path) == [name] and (tmp_path / name).read_text() == "second"
    assert (tmp_path / name).stat().st_mode & 0o777 == 0o666 & ~os.umask(os.umask(0o22))


KILLED = """
import os, signal, sys
from sci_lightning.files.atomic_file import atomic_write
with atomic_write(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_leftovers_of_killed_writers_go_and_nothing_else(tmp_path: Path) -> None:
    kept = [".a.npy", ".a-5f2k3.npy", ".a.12345678.part.npy", "a.part.npy", ".hidden"]
    for name in kept:
        (tmp_path / name).write_text("somebody's")
    for name in ("a.npy", "a.npy", "b.npy"):
        subprocess.run([sys.executable, "-c", KILLED, tmp_path / name], cwd=ROOT, check=False)
    assert len(os.listdir(tmp_path)) == len(kept) + 2  # the second writer of a.npy removed the first one's
    with atomic_write(tmp_path / "a.npy") as outer, atomic_write(tmp_path / "a.npy") as inner:
        assert outer.exists() and inner.exists()  # that of a living process stays
        inner.write_text("a")
        outer.write_text("a")
    left = sorted(set(os.listdir(tmp_path)) - set(kept))
    assert len(left) == 2 and left[0].startswith(".b.") and left[1] == "a.npy"
    elsewhere = left[0].replace(left[0].split(".")[3].split("-")[0], "00000000")  # written by another machine
    (tmp_path / left[0]).rename(tmp_path / elsewhere)
    with atomic_write(tmp_path / "b.npy"):
        pass
    assert (tmp_path / elsewhere).exists()
    old = time.time() - ABANDONED_AFTER - 1
    os.utime(tmp_path / elsewhere, (old, old))
    with atomic_write(tmp_path / "b.npy"):
        pass
    assert sorted(os.listdir(tmp_path)) == sorted([*kept, "a.npy", "b.npy"])


def test_file_and_folder_are_on_the_disk_when_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[str] = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(
        os, "fsync", lambda handle: (steps.append(os.readlink(f"/proc/self/fd/{handle}")), fsync(handle))
    )
    monkeypatch.setattr(os, "replace", lambda *names: (steps.append("replace"), replace(*names)))
    with atomic_write(tmp_path / "a.txt") as temporary:
        temporary.write_text("a")
    assert steps == [str(temporary), "replace", str(tmp_path)]


def stopped(done: subprocess.CompletedProcess[str], file: str) -> None:
    """The command ended with one line about a file that could not be written."""
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert done.returncode == 1 and len(lines) == 1 and "Traceback" not in done.stderr, done.stderr
    assert file in lines[0] and "free some space" in lines[0]


def test_virtual_camera_on_a_full_disk(command: Command, tmp_path: Path) -> None:
    write(tmp_path / "a.h5")
    before = (tmp_path / "a.h5").read_bytes()
    with nearly_full_disk(1000):
        stopped(command("virtual_camera", "out=a.h5", "size=[16,16]", "frames=4"), "a.h5: file too large")
    assert os.listdir(tmp_path) == ["a.h5"] and (tmp_path / "a.h5").read_bytes() == before


@pytest.mark.slow
def test_train_and_convert_on_a_full_disk(command: Command, tmp_path: Path) -> None:
    with nearly_full_disk(20_000):
        stopped(command("train", *TINY, "out=RUN"), "file too large")
    assert not list(tmp_path.rglob("*.ckpt"))
    assert command("train", *TINY, "out=RUN").returncode == 0
    with nearly_full_disk(20_000):
        stopped(command("convert", "checkpoint=RUN/checkpoints/last.ckpt", "out=a.safetensors"), "a.safetensors: ")
    assert not list(tmp_path.glob("*a.*"))


PACK = """
import resource, sys
from sci_lightning.cli.commands.captures import main
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
sys.argv = ["captures", "pack", "LAB", "out=lab.h5"]
main()
"""


def test_pack_on_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "LAB").mkdir()
    np.save(tmp_path / "LAB" / "masks.npy", np.random.default_rng(0).random((4, 32, 32)))
    np.save(tmp_path / "LAB" / "grey.npy", np.random.default_rng(0).integers(0, 256, (2, 32, 32)).astype(np.uint8))
    text = "{bit_depth: 8, patterns: masks.npy, captures: [{measurement: grey.npy}]}"
    (tmp_path / "LAB" / "captures.yaml").write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", PACK], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (1, ""), done.stderr
    assert done.stderr.splitlines()[-1].startswith("error: lab.h5: file too large")
    assert "Traceback" not in done.stderr and os.listdir(tmp_path) == ["LAB"]


def test_h5py_is_not_what_writes_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    captures = read_captures(write(tmp_path / "captures.h5"))
    opened: list[object] = []
    original = h5py.File.__init__

    def note(self: h5py.File, name: object, mode: str = "r", **options: object) -> None:
        if mode != "r":
            opened.append(name)
        original(self, name, mode, **options)

    monkeypatch.setattr(h5py.File, "__init__", note)
    write_captures(tmp_path / "a.h5", captures)
    assert len(opened) == 1 and not isinstance(opened[0], (str, Path))
