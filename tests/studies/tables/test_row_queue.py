"""The queue of rows: several at a time, failures, being asked to stop, and being killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sci_lightning.studies.tables.rows import TableRow
from tests.conftest import ROOT
from tests.studies.tables.waiting_rows import ROWS, WAITS, queue


def test_a_row_that_fails_stops_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows, finished = queue(tmp_path, lambda row: f"raise SystemExit({'no' if row.decoder == 'two' else 0!r})")
    rows.run()
    assert finished == ["one", "three"]
    (failed, line), *others = rows.failed.items()
    assert failed.decoder == "two" and line.startswith("status 1: no (") and not others
    assert str(rows.log(failed)) in line
    assert "failed rbw_sr_1bit_two, seed 0" in capsys.readouterr().out


def test_rows_compute_on_one_thread_each(tmp_path: Path) -> None:
    rows, _ = queue(tmp_path, lambda row: "import os; print(os.environ['OMP_NUM_THREADS'])", workers=3)
    rows.run()
    assert [rows.log(row).read_text() for row in ROWS] == ["1\n"] * 3


def wait_for(path: Path) -> None:
    until = time.monotonic() + 120
    while not path.exists():
        assert time.monotonic() < until, path
        time.sleep(0.02)


QUEUE = """
import sys
from pathlib import Path
from tests.studies.tables.waiting_rows import WAITS, queue
queue(Path(sys.argv[1]), lambda row: WAITS, workers=2)[0].run()
"""


@pytest.fixture
def started(tmp_path: Path) -> subprocess.Popen[bytes]:
    """A queue in a process of its own, of which two rows are running."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-c", QUEUE, str(tmp_path)], env=environment, cwd=ROOT)
    for row in ROWS[:2]:
        wait_for(tmp_path / row.folder / "running")
    return process


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_stop(number: signal.Signals, started: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """Rows that run are asked once to write a checkpoint, and no other is started."""
    started.send_signal(number)
    assert started.wait(120) != 0
    assert [(tmp_path / row.folder / "asked").exists() for row in ROWS] == [True, True, False]
    assert not (tmp_path / ROWS[2].folder).exists()


@pytest.mark.skipif(sys.platform != "linux", reason="the signal at a parent's end is Linux's")
def test_killed_and_started_again(started: subprocess.Popen[bytes], tmp_path: Path) -> None:
    """Rows of a killed queue are asked to stop by the system; the next queue waits for folders that are not free."""
    started.kill()
    started.wait(120)
    for row in ROWS[:2]:
        wait_for(tmp_path / row.folder / "asked")
    again, finished = queue(tmp_path, lambda row: "print('goes on')")
    again.run()
    assert finished == ["one", "two", "three"]


def test_a_folder_that_is_written_is_waited_for(tmp_path: Path) -> None:
    writer = subprocess.Popen([sys.executable, "-c", WAITS, str(tmp_path / ROWS[0].folder)], cwd=ROOT)
    wait_for(tmp_path / ROWS[0].folder / "running")
    rows, finished = queue(tmp_path, lambda row: "pass")
    ended: list[bool] = []

    def done(row: TableRow) -> None:
        finished.append(row.decoder)
        ended.append(writer.poll() is not None)
        if row.decoder == "three":
            writer.terminate()

    rows.finished = done
    rows.run()
    assert finished == ["two", "three", "one"] and ended == [False, False, True]
