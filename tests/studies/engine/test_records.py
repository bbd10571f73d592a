"""Records: written whole, read again, refused where they are of something else; and claims on cases."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.engine import FailedCase
from tests.conftest import ROOT
from tests.files.formats import check
from tests.studies.engine.numbers import Number, Square, records, square

CASES = [Number(number) for number in range(4)]


def test_what_is_missing(tmp_path: Path) -> None:
    kept = records(tmp_path)
    assert kept.missing(CASES) == CASES and kept.read() == [] and kept.ended(CASES[0]) is None
    assert not (tmp_path / "cases").exists()
    kept.write(CASES[2], square(CASES[2]))
    kept.fail(CASES[1], "ValueError: no", "Traceback")
    ended, failed = kept.ended(CASES[2]), kept.ended(CASES[1])
    assert isinstance(ended, Square) and ended.square == 4
    assert isinstance(failed, FailedCase) and str(failed) == "number_00001: ValueError: no"
    check("failed_case", failed.as_json())
    assert kept.failures() == [failed] and [record.number for record in kept.read()] == [2]
    assert kept.missing(CASES) == [CASES[0], CASES[1], CASES[3]]
    assert kept.failures() == []  # it is tried again
    kept.fail(CASES[1], "again")
    kept.write(CASES[1], square(CASES[1]))
    assert kept.failures() == [] and len(kept.read()) == 2


def test_folders_of_two_machines_are_merged_by_copying(tmp_path: Path) -> None:
    here, there = records(tmp_path / "here"), records(tmp_path / "there")
    for case in CASES:
        (here if case.number % 2 else there).write(case, square(case))
    for path in there.folder.glob("*.json"):
        path.rename(here.folder / path.name)
    assert here.missing(CASES) == [] and [record.number for record in here.read()] == [0, 1, 2, 3]


def test_other_settings_are_refused(tmp_path: Path) -> None:
    kept = records(tmp_path)
    kept.write(CASES[0], square(CASES[0]))
    kept.fail(CASES[1], "no")
    with pytest.raises(
        BadInput,
        match=r"number_00000\.json: made with other settings \(.*\), and would be overwritten; give another out=",
    ):
        kept.missing([CASES[1], Number(0, "others")])
    assert kept.failures()  # nothing was changed before


@pytest.mark.parametrize("content", ["[]", "{}", "not JSON", '{"format": "sci-square"}', "7"])
def test_a_foreign_file_among_the_records(content: str, tmp_path: Path) -> None:
    kept = records(tmp_path)
    kept.folder.mkdir()
    (kept.folder / "number_00000.json").write_text(content)
    for read in (kept.read, lambda: kept.missing(CASES)):
        with pytest.raises(BadInput, match=r"number_00000\.json: .*not a record of this study"):
            read()


def test_a_record_that_a_killed_process_began_is_none(tmp_path: Path) -> None:
    kept = records(tmp_path)
    kept.folder.mkdir()
    (kept.folder / ".number_00000.12345678.12345678-1-12345678.part.json").write_text('{"format": ')
    assert kept.missing(CASES) == CASES and kept.read() == []


CLAIM = """
import sys
from pathlib import Path
from tests.studies.engine.numbers import Number, records
with records(Path(sys.argv[1])).claims() as claims:
    print(claims.take(Number(0)), claims.take(Number(1)), flush=True)
    sys.stdin.read()
"""


def test_no_two_processes_claim_a_case(tmp_path: Path) -> None:
    with records(tmp_path).claims() as claims:
        assert claims.take(CASES[0])
        words = [sys.executable, "-c", CLAIM, str(tmp_path)]
        other = subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert other.stdout and other.stdout.readline() == "False True\n"
        assert not claims.take(CASES[1]) and claims.take(CASES[2])
        other.kill()
        other.communicate()
        assert claims.take(CASES[1])  # whoever claimed it has died
        claims.release(CASES[0])
