"""The folder of a diagnosis is replaced as a whole, or stays as it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.diagnosis.report.report_folder import check_no_foreign_report, report_folder
from sci_lightning.errors import BadInput


def test_replaced_as_a_whole(tmp_path: Path) -> None:
    for name in ("report.json", "unnamed_1.png", "gap.png", "prnu.npy", "notes.txt"):
        (tmp_path / name).write_text("old")
    with report_folder(tmp_path) as folder:
        (folder / "report.json").write_text("new")
        assert (tmp_path / "report.json").read_text() == "old"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "report.json": "new",
        "prnu.npy": "old",
        "notes.txt": "old",
    }


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_interrupted(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "report.html").write_text("old")
    with pytest.raises(error), report_folder(tmp_path) as folder:
        (folder / "report.html").write_text("new")
        raise error
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "old"


def test_left_by_a_process_that_was_killed(tmp_path: Path) -> None:
    (tmp_path / ".report-abc").mkdir()
    (tmp_path / ".report-abc" / "report.html").write_text("half")
    elsewhere = tmp_path.parent / "elsewhere"
    elsewhere.mkdir(exist_ok=True)
    (tmp_path / ".report-link").symlink_to(elsewhere)
    with report_folder(tmp_path) as folder:
        (folder / "snapshots.json").write_text("{}")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".report-link", "snapshots.json"]
    assert elsewhere.is_dir()


def test_foreign_files(tmp_path: Path) -> None:
    check_no_foreign_report(tmp_path / "absent")
    (tmp_path / "report.html").write_text("somebody's")
    with pytest.raises(BadInput, match=r"holds report\.html, which no diagnosis wrote"):
        check_no_foreign_report(tmp_path)
    (tmp_path / "report.json").write_text("{}")
    check_no_foreign_report(tmp_path)
