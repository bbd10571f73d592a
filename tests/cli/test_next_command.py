"""What a command says to run next runs as it stands."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from sci_lightning.cli.next_command import browser, dashboard, invocation, override, print_next
from sci_lightning.console import PlainConsole
from tests.conftest import next_lines
from tests.training.small_training import TINY


@pytest.mark.parametrize("value", ["run/a.ckpt", "my runs/a,b.ckpt", "it's [1]", "a=b{c}", "back\\slash", "$HOME/x y"])
def test_any_path_survives_shell_and_hydra(value: str) -> None:
    line = shlex.join([override("ckpt_path", value)])
    (word,) = shlex.split(line)
    assert OverridesParser.create().parse_override(word).value() == value


def test_lines(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    line = invocation("evaluate", "data=synthetic", paths={"ckpt_path": tmp_path / "my run" / "last.ckpt"})
    assert shlex.split(line)[1:] == ["-m", "sci_lightning.evaluate", "ckpt_path='my run/last.ckpt'", "data=synthetic"]
    assert shlex.split(browser("a b.html"))[-1] == f"{tmp_path.as_uri()}/a%20b.html"
    print_next(PlainConsole(), line, "second")
    assert next_lines(capsys.readouterr().out) == [line, "second"]


def test_a_dashboard_is_that_of_the_running_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    monkeypatch.setattr("sys.executable", str(programs / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert dashboard("a run") == "tensorboard --logdir 'a run'"
    (programs / "tensorboard").touch(0o755)
    assert dashboard(tmp_path / "run") == ".venv/bin/tensorboard --logdir run"
    monkeypatch.setenv("PATH", str(programs))
    assert dashboard("run") == "tensorboard --logdir run"


@pytest.mark.slow
def test_what_is_printed_runs(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    """From a training and from a virtual camera on, in folders whose names need quotes."""

    def follow(line: str) -> str:
        program, flag, module, *words = shlex.split(line)
        assert shutil.which(program) and flag == "-m"
        done = command(module.removeprefix("sci_lightning."), *words)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        return done.stdout

    trained = command("train", *TINY, "out='a run'", "logger=[tensorboard,csv]")
    evaluate, export, board = next_lines(trained.stdout)
    assert (tmp_path / "a run" / "csv" / "metrics.csv").read_text().startswith("epoch,")
    assert (tmp_path / "a run" / "tensorboard" / "lsw_sr_4bit_e2e_cnn").is_dir()
    program, *words = shlex.split(board)
    assert Path(program).name == "tensorboard" and words == ["--logdir", "a run"]
    assert "sci_lightning.reconstruct" in next_lines(follow(export))[0]
    assert "sci_lightning.tables" in next_lines(follow(evaluate))[0]
    camera = ["size=[32,32]", "flat=1", "static=1", "dynamic=1", "pattern=1", "dark=1", "all_on=1", "all_off=1"]
    (diagnose,) = next_lines(command("virtual_camera", *camera, "out='lab 1/captures.h5'").stdout)
    train, reveal = next_lines(follow(diagnose))
    assert "sci_lightning.virtual_camera.reveal" in reveal and "captures.truth.json" in reveal
    follow(f"{train} scale=smoke out=retrained data.scenes_count=1 decoder.channels=4 metrics.qscore=null")
