"""``python -m sci_lightning.proving_ground``: records outlive crashes and interruptions."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.proving_ground.case import Case
from sci_lightning.proving_ground.crew import work_through
from sci_lightning.proving_ground.records import Records
from sci_lightning.virtual_camera import Session
from tests.conftest import ROOT

NAME = "proving_ground"
SMALL = ("size=[32,32]", "frames=4", "workers=1", "masks=[structural]", "bit_depths=[8]")


class Deadly(Case):
    """A case whose process dies of it."""

    @property
    def magnitude(self) -> str:
        if multiprocessing.parent_process() is not None:
            os._exit(3)
        return "clear"


def test_a_case_and_its_record(command: Callable[..., Any], tmp_path: Path) -> None:
    done = command(NAME, *SMALL, "suites=[single]", "effects=[gain]", "out=a")
    assert done.returncode == 0, done.stderr
    assert "right  gain (structural, 8 bits" in done.stdout
    (path,) = (tmp_path / "a" / "cases").iterdir()
    record = json.loads(path.read_text())
    assert path.stem == record["case"] == "single-gain-structural-8bit-32x32-4slots-full-0"
    assert record["verdict"] == "explained" and record["true_names"] is None
    ((hidden,), (found,)) = record["hidden"], record["found"]
    assert hidden["log_likelihood_gain"] == pytest.approx(record["log_likelihood_gain"]) and hidden["name"] == "gain"
    value = found["parameters"]["factor"]
    assert abs(value["value"] - hidden["parameters"]["factor"]) < 5 * value["std"]
    assert record["gap"]["after"]["chi2"] < record["gap"]["before"]["chi2"]
    assert record["cpu_seconds"] > 0 and 0 < record["seconds"] < 60 and 50 < record["memory_mib"] < 2000
    assert {"summary.md", "summary.json", "confusion.png"} <= {each.name for each in (tmp_path / "a").iterdir()}


def test_an_interrupted_run_goes_on(command: Callable[..., Any], tmp_path: Path) -> None:
    wanted = [*SMALL, "suites=[nothing]", "cases=3", "out=a"]
    arguments = [sys.executable, "-m", f"sci_lightning.{NAME}", *wanted]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(arguments, cwd=tmp_path, env=environment, start_new_session=True, **pipes)
    cases = tmp_path / "a" / "cases"
    deadline = time.monotonic() + 400
    while not list(cases.glob("[!.]*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the command and to its workers
    _, said = process.communicate(timeout=120)
    assert process.returncode == 1 and said.strip() == "interrupted"
    kept = {path.name: path.stat().st_mtime_ns for path in cases.iterdir()}
    assert 1 <= len(kept) < 3 and not any(name.startswith(".") for name in kept)

    done = command(NAME, *wanted)
    assert done.returncode == 0, done.stderr
    assert f"{3 - len(kept)} cases to try, {len(kept)} done before" in done.stdout
    now = {path.name: path.stat().st_mtime_ns for path in cases.iterdir()}
    assert len(now) == 3 and kept.items() <= now.items()
    again = command(NAME, "run=false", "out=a")
    assert "nothing hidden, structural mask: false alarms: 0.0% (0 of 3" in again.stdout


def test_a_crash_stays_in_its_record(tmp_path: Path) -> None:
    session = Session(size=(16, 16), frames=2)
    cases = [
        Deadly("nothing", (), "full", session),
        Case("nothing", (), "full", Session(size=(16, 16), frames=2, mask="gone.npy")),
        Case("nothing", (), "full", session, turn=1),
    ]
    found = {each["case"]: each for each in work_through(cases, workers=2)}
    died, refused, fine = (found[case.name] for case in cases)
    assert died["failed"] == "the process died with exit code 3"
    assert "gone.npy: no such file" in refused["failed"] and "Traceback" in refused["traceback"]
    assert "failed" not in fine
    records = Records(tmp_path)
    for each in (died, refused, fine):
        records.write(each)
    assert [records.has(case) for case in cases] == [False, False, True]  # the failed ones are tried again
    assert not records.has(Case("nothing", (), "moving", session, turn=1))


@pytest.mark.parametrize(
    ("override", "message"), [("run=false", "no records to sum up"), ("suites=[singles]", "no 'singles'; choose of")]
)
def test_bad_input_is_one_line(command: Callable[..., Any], override: str, message: str) -> None:
    done = command(NAME, override, "out=a")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ") and message in line


def test_a_foreign_file_among_the_records(tmp_path: Path) -> None:
    (tmp_path / "foreign.json").write_text("[]")
    with pytest.raises(BadInput, match=r"foreign\.json: not a record of the proving ground"):
        Records(tmp_path).read()
