"""Runs do not mix: one folder, one process; and nothing of a dead one stands in the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.run_folder import is_first_process, remove_leftovers, run_folder
from tests.conftest import ROOT

Refused = Callable[..., str]
KEEPER = """
import sys, time
from sci_lightning.run_folder import run_folder
with run_folder(sys.argv[1]):
    print("mine", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def keeper(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that keeps the folder ``run``."""
    process = subprocess.Popen(
        [sys.executable, "-c", KEEPER, str(tmp_path / "run")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "mine\n"
    yield process
    process.kill()
    process.communicate()


def test_a_folder_is_kept_until_its_process_ends(tmp_path: Path, keeper: subprocess.Popen[str]) -> None:
    line = rf"run: process {keeper.pid} on .* is writing there; give another out="
    with pytest.raises(BadInput, match=line), run_folder(tmp_path / "run"):
        raise AssertionError("two processes in one folder")
    with run_folder(tmp_path / "other"):
        pass
    keeper.send_signal(signal.SIGKILL)
    keeper.wait()
    assert (tmp_path / "run" / ".lock").exists()
    with run_folder(tmp_path / "run"):
        pass
    assert not (tmp_path / "run" / ".lock").exists()


def test_a_command_leaves_a_kept_folder_as_it_is(
    refused: Refused, tmp_path: Path, keeper: subprocess.Popen[str]
) -> None:
    before = sorted((tmp_path / "run").rglob("*"))
    line = refused("train", "out=run", "decoder=e2e_cnn")
    assert f"process {keeper.pid}" in line and "out=" in line
    assert sorted((tmp_path / "run").rglob("*")) == before


def test_other_processes_of_a_run_share_its_folder(
    tmp_path: Path, keeper: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_first_process()
    for name in ("LOCAL_RANK", "SLURM_PROCID", "RANK"):
        monkeypatch.setenv(name, "0")
        assert is_first_process()
        monkeypatch.setenv(name, "1")
        assert not is_first_process()
        with run_folder(tmp_path / "run"):
            pass
        monkeypatch.delenv(name)


def test_commands_of_one_second_get_a_folder_each(tmp_path: Path) -> None:
    arguments = [sys.executable, "-m", "sci_lightning.tables", f"runs={tmp_path}", "nonsense=1", "debug=false"]
    arguments[4] = "out=outputs/${now:%S}"  # the names come round: a folder per second
    processes = [
        subprocess.Popen(arguments, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, stderr=subprocess.PIPE)
        for _ in range(3)
    ]
    for process in processes:
        process.communicate()
    assert len(list((tmp_path / "outputs").iterdir())) == 3


def test_leftovers_of_killed_writers_are_removed(tmp_path: Path) -> None:
    checkpoints, elsewhere = tmp_path / "checkpoints", tmp_path / ".last-abcdefgh.ckpt"
    checkpoints.mkdir()
    elsewhere.touch()
    kept = ["last.ckpt", ".mine.ckpt", ".last-mine.ckpt", ".last-abcdefgh.txt"]
    for name in [*kept, ".last-a1_c3f5h.ckpt", ".best-a1_c3f5h.ckpt"]:
        (checkpoints / name).touch()
    (checkpoints / ".last-linklink.ckpt").symlink_to(elsewhere)
    remove_leftovers(checkpoints)
    assert {path.name for path in checkpoints.iterdir()} == {*kept, ".last-linklink.ckpt"}
    assert elsewhere.exists()
    remove_leftovers(tmp_path / "absent")


def test_the_lock_is_never_a_link(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock").symlink_to(tmp_path / "thesis.tex")
    with pytest.raises(BadInput, match="expected the lock of a run"), run_folder(tmp_path / "run"):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    (tmp_path / "run" / ".lock").unlink()
    os.mkfifo(tmp_path / "run" / ".lock")
    with pytest.raises(BadInput, match="expected the lock of a run"), run_folder(tmp_path / "run"):
        pass
