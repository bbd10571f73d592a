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
from sci_lightning.runs.run_folder import is_first_process, run_folder
from tests.conftest import ROOT

Refused = Callable[..., str]
KEEPER = """
import sys, time
from sci_lightning.runs.run_folder import run_folder
with run_folder(sys.argv[1]):
    print("mine", flush=True)
    sys.stdin.read()
"""

STARTED = """
from hydra.core.utils import setup_globals
from omegaconf import OmegaConf
from sci_lightning.cli.hydra_callbacks import OwnFolder
setup_globals()
OwnFolder().on_run_start(OmegaConf.create({"out": "outputs/${now:%S}", "hydra": {"run": {"dir": "${out}"}}}))
"""  # the names come round: a folder per second


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
    processes = [
        subprocess.Popen([sys.executable, "-c", STARTED], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
        for _ in range(3)
    ]
    for process in processes:
        process.communicate()
    assert len(list((tmp_path / "outputs").iterdir())) == 3


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


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.parametrize("arguments", [("train", "resume=false"), ("evaluate", "decoder=gap_tv")])
def test_a_second_run_in_a_folder_changes_nothing_there(
    refused: Refused, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    (tmp_path / "run" / "checkpoints").mkdir(parents=True)
    (tmp_path / "run" / "checkpoints" / "last.ckpt").write_text("hours of work")
    before = contents(tmp_path)
    assert "another out=" in refused(*arguments, "out=run")
    assert contents(tmp_path) == before


def test_rows_of_a_sweep_that_are_there_are_not_overwritten(
    ran: Callable[..., str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for row in "01":
        (tmp_path / "sweep" / row).mkdir(parents=True)
        (tmp_path / "sweep" / row / "metrics.json").write_text("{}")
    before = {path: content for path, content in contents(tmp_path).items() if path.name == "metrics.json"}
    with pytest.raises(SystemExit) as caught:
        ran("train", "-m", "decoder=e2e_cnn", "seed=1,2", "out=sweep")
    errors = capsys.readouterr().err.splitlines()
    assert caught.value.code == 2 and len(errors) == 2
    assert all(f"sweep/{row}: holds an earlier run" in errors[row] for row in (0, 1))
    after = contents(tmp_path / "sweep")
    assert {path: after[path] for path in before} == before
    assert {path.name for path in after} == {"0", "1", "metrics.json", "multirun.yaml"}


@pytest.mark.parametrize("out", [[], ["out=a/b"]])
def test_a_refused_command_leaves_nothing(refused: Refused, tmp_path: Path, out: list[str]) -> None:
    refused("train", "decoder=gap_tv", *out)
    assert not list(tmp_path.iterdir())


def test_a_refused_command_leaves_what_was_there(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    refused("train", "decoder=gap_tv", "out=there")
    assert (tmp_path / "there").is_dir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").touch()
    refused("train", "decoder=gap_tv", "out=mine/run")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]
