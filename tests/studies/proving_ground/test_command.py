"""``python -m sci_lightning.proving_ground``: records outlive interruptions."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.cli.commands.proving_ground import run_missing
from sci_lightning.console import PlainConsole
from sci_lightning.studies.engine import FailedCase, Records
from sci_lightning.studies.proving_ground import trial
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.virtual_camera import Session
from tests.conftest import ROOT
from tests.files.formats import check
from tests.studies.proving_ground.conftest import ABOUT

NAME = "proving_ground"
SMALL = ("size=[32,32]", "slots=[4]", "workers=1", "masks=[structural]", "bit_depths=[8]")
HERE = ("workers=0", "suites=[nothing]")
WHERE = {"workers": 0, "threads": 1, "job": None}
SESSION = Session(size=(16, 16), frames=2)


@pytest.fixture
def ran_cases(monkeypatch: pytest.MonkeyPatch, record: Callable[..., Any]) -> list[str]:
    """Names of the cases that were run, in place of which records made by hand are returned at once."""
    names: list[str] = []

    def at_once(case: Case) -> dict[str, Any]:
        names.append(case.name)
        return {key: value for key, value in record("nothing", {}, {}).items() if key not in ABOUT}

    monkeypatch.setattr(trial, "run_trial", at_once)
    return names


@pytest.mark.slow
def test_cases_with_a_record_are_not_run_again(
    ran: Callable[..., str], refused: Callable[..., str], ran_cases: list[str], tmp_path: Path
) -> None:
    text = ran(NAME, *SMALL, *HERE, "cases=2", "out=a")
    assert "2 cases to try, 0 done before" in text and "right  nothing (structural, 8 bits" in text
    assert {"summary.md", "summary.json", "confusion.png", "cases"} <= {
        path.name for path in (tmp_path / "a").iterdir()
    }
    text = ran(NAME, *SMALL, *HERE, "cases=3", "out=a")
    assert "1 cases to try, 2 done before" in text and len(set(ran_cases)) == len(ran_cases) == 3
    assert "nothing hidden, structural mask: false alarms: 0.0% (0 of 3" in text
    first, second, third = sorted((tmp_path / "a" / "cases").glob("*.json"))
    about = json.loads(second.read_text())
    second.unlink()
    failed = FailedCase(case=second.stem, about=about, failed="out of memory")
    (second.parent / "failed").mkdir(exist_ok=True)
    (second.parent / "failed" / second.name).write_text(json.dumps(failed.as_json()))
    assert "cases that failed: 1 of 3" in ran(NAME, "run=false", "out=a")
    kept = third.read_bytes()
    assert "1 cases to try, 2 done before" in ran(NAME, *SMALL, *HERE, "cases=3", "out=a")
    assert "nothing hidden, structural mask: false alarms: 0.0% (0 of 3" in ran(NAME, "run=false", "out=a")
    assert len(ran_cases) == 4 and third.read_bytes() == kept
    first.write_text(first.read_text().replace(json.loads(first.read_text())["digest"], "0" * 16))
    assert f"{first.name}: made with other settings" in refused(NAME, *SMALL, *HERE, "cases=3", "out=a")


def test_all_cases(ran: Callable[..., str], ran_cases: list[str]) -> None:
    ran(NAME, *SMALL, *HERE, "cases=null", "seeds=2", "out=a")
    assert len(set(ran_cases)) == 24


def test_a_record_is_kept_when_the_next_case_is_interrupted(
    ran_cases: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = [Case("nothing", (), "full", SESSION, number) for number in range(3)]
    files, at_once = Records(tmp_path / "cases", Outcome), trial.run_trial

    def interrupted(case: Case) -> dict[str, Any]:
        if case is cases[1]:
            raise KeyboardInterrupt
        return at_once(case)

    with monkeypatch.context() as patch:
        patch.setattr(trial, "run_trial", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_missing(cases, files, WHERE, PlainConsole())
    assert files.missing(cases) == cases[1:]
    run_missing(cases, files, WHERE, PlainConsole())
    assert ran_cases == [case.name for case in cases]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("run=false", "no records to sum up"),
        ("suites=[singles]", "no 'singles'; choose of"),
        ("workers=-1", "workers=-1: expected"),
    ],
)
def test_bad_input_is_one_line(refused: Callable[..., str], override: str, message: str) -> None:
    assert message in refused(NAME, override, "out=a")


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_goes_on(how: signal.Signals, command: Callable[..., Any], tmp_path: Path) -> None:
    wanted = [*SMALL, "suites=[nothing]", "cases=3", "out=a"]
    arguments = [sys.executable, "-m", f"sci_lightning.{NAME}", *wanted]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(arguments, cwd=tmp_path, env=environment, start_new_session=True, **pipes)
    folder = tmp_path / "a" / "cases"
    deadline = time.monotonic() + 400
    while not list(folder.glob("[!.]*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    if how == signal.SIGKILL:
        process.kill()  # the command only: its worker ends by itself
    else:
        os.killpg(process.pid, how)  # as a terminal does: to the command and to its workers
    _, said = process.communicate(timeout=120)  # which waits for the worker, too: it holds the pipes
    if how == signal.SIGINT:
        assert process.returncode == 130 and said.strip() == "interrupted"
    kept = {path: path.read_bytes() for path in folder.glob("[!.]*.json")}
    assert 1 <= len(kept) < 3

    done = command(NAME, *wanted)
    assert done.returncode == 0, done.stderr
    assert f"{3 - len(kept)} cases to try, {len(kept)} done before" in done.stdout
    now = {path: path.read_bytes() for path in folder.glob("[!.]*.json")}
    assert len(now) == 3 and kept.items() <= now.items()
    for content in now.values():
        check("proving_ground_case", json.loads(content))
