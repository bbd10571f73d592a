"""The processes of a lease: several at a time, failures, being asked to stop, and being killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.studies.relay.waiting_rows import LEASED, WAITS, processes


def test_one_that_fails_stops_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    all_of, finished = processes(tmp_path, lambda one: f"raise SystemExit({'no' if one.name == 'two' else 0!r})")
    all_of.run()
    assert sorted(finished) == ["one", "three"]
    (failed, line), *others = all_of.failed.items()
    assert failed.name == "two" and line.startswith("status 1: no (") and not others
    assert str(all_of.log(failed)) in line
    assert "failed two, seed 0" in capsys.readouterr().out


def test_each_computes_on_one_thread(tmp_path: Path) -> None:
    all_of, _ = processes(tmp_path, lambda one: "import os; print(os.environ['OMP_NUM_THREADS'])")
    all_of.run()
    assert [all_of.log(one).read_text() for one in LEASED] == ["1\n"] * 3


def wait_for(path: Path) -> None:
    until = time.monotonic() + 120
    while not path.exists():
        assert time.monotonic() < until, path
        time.sleep(0.02)


PARENT = """
import sys
from pathlib import Path
from tests.studies.relay.waiting_rows import WAITS, processes
processes(Path(sys.argv[1]), lambda one: WAITS)[0].run()
"""


@pytest.fixture
def started(tmp_path: Path) -> subprocess.Popen[bytes]:
    """A process of which all commands are running."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-c", PARENT, str(tmp_path)], env=environment, cwd=ROOT)
    for one in LEASED:
        wait_for(tmp_path / one.folder / "running")
    return process


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_stop(number: signal.Signals, started: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """What runs is asked once to write a checkpoint."""
    started.send_signal(number)
    assert started.wait(120) != 0
    assert all((tmp_path / one.folder / "asked").exists() for one in LEASED)


@pytest.mark.skipif(sys.platform != "linux", reason="the signal at a parent's end is Linux's")
def test_killed(started: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """What a killed process has started is asked to stop by the system."""
    started.kill()
    started.wait(120)
    for one in LEASED:
        wait_for(tmp_path / one.folder / "asked")


def test_the_time_is_over(tmp_path: Path) -> None:
    all_of, finished = processes(tmp_path, lambda one: WAITS, seconds=0.0)
    for one in LEASED:
        (tmp_path / one.folder).mkdir(parents=True)
    all_of.run()
    assert finished == [] and all_of.failed == {}
