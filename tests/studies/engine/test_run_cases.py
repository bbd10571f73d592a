"""Cases in this process, in processes of their own, and in jobs that share a folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sci_lightning.errors import MachineFailure
from sci_lightning.studies.engine import FailedCase, run_cases
from tests.conftest import ROOT
from tests.studies.engine.numbers import Number, Square, records, square

CASES = [Number(number) for number in (1, 13, 5)]


def test_in_this_process(tmp_path: Path) -> None:
    kept = records(tmp_path)
    ended = list(run_cases(square, kept.missing(CASES), kept))
    one, unlucky, five = ended
    assert one.square == 1 and five.square == 25
    assert isinstance(unlucky, FailedCase) and "ValueError: an unlucky number" in unlucky.failed
    assert "Traceback" in unlucky.traceback
    with pytest.raises(MachineFailure, match="1 of 3 cases failed; number_00013: ValueError"):
        kept.all_of(CASES, print)
    said: list[str] = []
    assert kept.all_of([*CASES, Number(7)], said.append) == []
    assert said == ["1 of 4 cases are run by other processes, the last of which sums up"]
    assert kept.all_of([CASES[2], CASES[0]], print) == [five, one]
    assert kept.missing(CASES) == [CASES[1]]


@pytest.mark.slow
def test_a_crash_stays_in_its_record(tmp_path: Path) -> None:
    kept, cases = records(tmp_path), [*CASES, Number(99), Number(4)]
    ended = list(run_cases(square, cases, kept, workers=2))
    assert sorted(record.square for record in ended if isinstance(record, Square)) == [1, 16, 25]
    assert len({record.process for record in ended if isinstance(record, Square)}) == 3
    failed = {failure.case: failure for failure in ended if isinstance(failure, FailedCase)}
    assert failed["number_00099"].failed == "the process died with exit code 3"
    assert "ValueError" in failed["number_00013"].failed and "Traceback" in failed["number_00013"].traceback
    assert kept.missing(cases) == [CASES[1], cases[3]]  # failed cases are run again


def test_a_case_that_ended_elsewhere_meanwhile_is_not_run(tmp_path: Path) -> None:
    kept = records(tmp_path)
    waiting = kept.missing(CASES)
    kept.write(CASES[2], square(CASES[2]) | {"process": 0})
    assert [one.number for one in run_cases(square, waiting, kept) if isinstance(one, Square)] == [1]
    assert kept.read()[-1].process == 0


WORK_OFF = """
import sys
from pathlib import Path
from sci_lightning.studies.engine import run_cases
from tests.studies.engine.numbers import Number, records, slow_square
kept, cases = records(Path(sys.argv[1])), [Number(number) for number in range(6)]
for ended in run_cases(slow_square, kept.missing(cases, 1), kept, job=int(sys.argv[2])):
    print(ended.number, flush=True)
"""


def test_jobs_on_one_folder_run_no_case_twice(tmp_path: Path) -> None:
    """One of them is killed in the middle; another one does what is left."""
    words = [sys.executable, "-c", WORK_OFF, str(tmp_path)]
    first, second = (subprocess.Popen([*words, job], cwd=ROOT, stdout=subprocess.PIPE, text=True) for job in ("0", "1"))
    assert first.stdout and first.stdout.readline() == "0\n"
    first.kill()
    done = [0, *map(int, first.communicate()[0].split()), *map(int, second.communicate()[0].split())]
    kept = records(tmp_path)
    rest = [one.number for one in run_cases(square, kept.missing([Number(number) for number in range(6)]), kept)]
    assert sorted([*done, *rest]) == [0, 1, 2, 3, 4, 5] and len(rest) <= 1


def test_only_the_first_job_forgets_failures(tmp_path: Path) -> None:
    kept = records(tmp_path)
    kept.fail(CASES[1], "no")
    assert kept.missing(CASES, 3) == CASES and kept.failures()
    assert len(list(run_cases(square, kept.missing(CASES, 3), kept, job=3))) == 2  # it is left to the next run
    assert kept.missing(CASES, 0) == [CASES[1]] and not kept.failures()
