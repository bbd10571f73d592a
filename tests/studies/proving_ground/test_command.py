"""``python -m sci_lightning.proving_ground``: records outlive crashes and interruptions."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.proving_ground import worker_processes
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.studies.proving_ground.outcome import Failure
from sci_lightning.studies.proving_ground.records import Records
from sci_lightning.studies.proving_ground.worker_processes import run_cases
from sci_lightning.virtual_camera import Session
from tests.conftest import ROOT
from tests.files.formats import check

NAME = "proving_ground"
SMALL = ("size=[32,32]", "slots=[4]", "workers=1", "masks=[structural]", "bit_depths=[8]")
SESSION = Session(size=(16, 16), frames=2)


class Deadly(Case):
    """A case whose process dies of it."""

    @property
    def magnitude(self) -> str:
        if multiprocessing.parent_process() is not None:
            os._exit(3)
        return "clear"


@pytest.fixture
def ran_cases(monkeypatch: pytest.MonkeyPatch, record: Callable[..., Any]) -> list[str]:
    """Names of the cases that were run, in place of which records made by hand are returned at once."""
    names: list[str] = []

    def run_at_once(cases: list[Case], workers: int, threads: int) -> Iterator[dict[str, Any]]:
        for case in cases:
            names.append(case.name)
            yield record("nothing", {}, {}) | case.describe()

    monkeypatch.setattr(worker_processes, "run_cases", run_at_once)
    return names


@pytest.mark.slow
def test_cases_with_a_record_are_not_run_again(ran: Callable[..., str], ran_cases: list[str], tmp_path: Path) -> None:
    text = ran(NAME, *SMALL, "suites=[nothing]", "cases=2", "out=a")
    assert "2 cases to try, 0 done before" in text and "right  nothing (structural, 8 bits" in text
    assert {"summary.md", "summary.json", "confusion.png", "cases.jsonl"} <= {
        path.name for path in (tmp_path / "a").iterdir()
    }
    text = ran(NAME, *SMALL, "suites=[nothing]", "cases=3", "out=a")
    assert "1 cases to try, 2 done before" in text and len(set(ran_cases)) == len(ran_cases) == 3
    assert "nothing hidden, structural mask: false alarms: 0.0% (0 of 3" in text
    file = tmp_path / "a" / "cases.jsonl"
    first, second, third = map(json.loads, file.read_text().splitlines())
    Records(file).write(first | {"digest": "0" * 16})  # of other settings
    known = {key: value for key, value in second.items() if key in Failure.model_fields}
    Records(file).write(known | {"failed": "out of memory"})
    assert "2 cases to try, 1 done before" in ran(NAME, *SMALL, "suites=[nothing]", "cases=3", "out=a")
    assert "nothing hidden, structural mask: false alarms: 0.0% (0 of 3" in ran(NAME, "run=false", "out=a")
    assert len(ran_cases) == 5 and len(file.read_text().splitlines()) == 7
    assert json.loads(file.read_text().splitlines()[2]) == third


def test_all_cases(ran: Callable[..., str], ran_cases: list[str]) -> None:
    ran(NAME, *SMALL, "suites=[nothing]", "cases=null", "seeds=2", "out=a")
    assert len(set(ran_cases)) == 24


def test_a_record_is_kept_when_the_next_case_is_interrupted(
    ran_cases: list[str], record: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sci_lightning.cli.commands.proving_ground import run_missing
    from sci_lightning.console import PlainConsole

    cases = [Case("nothing", (), "full", SESSION, number) for number in range(3)]
    files = Records(tmp_path / "cases.jsonl")

    def interrupted(cases: list[Case], workers: int, threads: int) -> Iterator[dict[str, Any]]:
        yield record("nothing", {}, {}) | cases[0].describe()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(worker_processes, "run_cases", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_missing(cases, files, 1, 1, PlainConsole())
    assert files.missing(cases) == cases[1:]
    run_missing(cases, files, 1, 1, PlainConsole())
    assert ran_cases == [case.name for case in cases[1:]]


@pytest.mark.slow
def test_a_crash_stays_in_its_record(tmp_path: Path) -> None:
    cases = [
        Deadly("nothing", (), "full", SESSION),
        Case("nothing", (), "full", Session(size=(16, 16), frames=2, mask="gone.npy")),
    ]
    died, refused = run_cases(cases, workers=1)
    assert died["case"] == cases[0].name and died["failed"] == "the process died with exit code 3"
    assert "gone.npy: no such file" in refused["failed"] and "Traceback" in refused["traceback"]
    for record in (died, refused):
        check("proving_ground_case", record)
        Records(tmp_path / "cases.jsonl").write(record)
    assert Records(tmp_path / "cases.jsonl").missing(cases) == cases  # failed cases are run again


@pytest.mark.parametrize(
    ("override", "message"), [("run=false", "no records to sum up"), ("suites=[singles]", "no 'singles'; choose of")]
)
def test_bad_input_is_one_line(refused: Callable[..., str], override: str, message: str) -> None:
    assert message in refused(NAME, override, "out=a")


def test_a_line_that_was_cut_off_is_run_again(tmp_path: Path, record: Callable[..., Any]) -> None:
    """As ``kill -9`` or a power cut leaves it: the record is not there, and the next one takes its place."""
    cases = [Case("nothing", (), "full", SESSION, number) for number in range(2)]
    file = tmp_path / "cases.jsonl"
    lines = []
    for case in cases:
        Records(file).write({**case.describe(), **record("nothing", {}, {}), **case.describe()})
        lines.append(file.read_bytes())
    for length in range(len(lines[0]), len(lines[1]), 97):
        file.write_bytes(lines[1][:length])
        assert Records(file).missing(cases) == cases[1:]
    Records(file).write(json.loads(lines[1].splitlines()[1]))
    assert file.read_bytes() == lines[1] and Records(file).missing(cases) == []


@pytest.mark.parametrize("content", ["[]", "{}", "not JSON", '{"format": "sci-proving-ground-case"}', "7"])
@pytest.mark.parametrize("end", ["", "\n"])
def test_a_foreign_file_among_the_records(content: str, end: str, tmp_path: Path) -> None:
    (tmp_path / "foreign.jsonl").write_text(content + end)
    with pytest.raises(BadInput, match=r"foreign\.jsonl, line 1: not a record"):
        Records(tmp_path / "foreign.jsonl").read()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_goes_on(how: signal.Signals, command: Callable[..., Any], tmp_path: Path) -> None:
    wanted = [*SMALL, "suites=[nothing]", "cases=3", "out=a"]
    arguments = [sys.executable, "-m", f"sci_lightning.{NAME}", *wanted]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(arguments, cwd=tmp_path, env=environment, start_new_session=True, **pipes)
    file = tmp_path / "a" / "cases.jsonl"
    deadline = time.monotonic() + 400
    while not file.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    if how == signal.SIGKILL:
        process.kill()  # the command only: its worker ends by itself
    else:
        os.killpg(process.pid, how)  # as a terminal does: to the command and to its workers
    _, said = process.communicate(timeout=120)  # which waits for the worker, too: it holds the pipes
    if how == signal.SIGINT:
        assert process.returncode == 130 and said.strip() == "interrupted"
    kept = file.read_text().splitlines()
    assert 1 <= len(kept) < 3

    done = command(NAME, *wanted)
    assert done.returncode == 0, done.stderr
    assert f"{3 - len(kept)} cases to try, {len(kept)} done before" in done.stdout
    now = file.read_text().splitlines()
    assert len(now) == 3 and now[: len(kept)] == kept
    for line in now:
        check("proving_ground_case", json.loads(line))
