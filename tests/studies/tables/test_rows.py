"""The trainings that the paper's tables need, their order, what is kept of them, and the command that trains them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.runs.provenance import Provenance
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.rows import TableRow, check_recipe, is_kept, keep, kept_files, plan
from tests.files.formats import check
from tests.studies.tables.conftest import Made

TABLES = paper_figures()["tables"]


def test_every_row_of_the_tables_is_trained_once() -> None:
    rows = plan(TABLES, seeds=1)
    # Tables 2, 3, 4; 5 random; 5 learned without 4 bits; controls
    assert len(rows) == len(set(rows)) == 7 + 4 + 5 + 4 + 3 + 7
    assert {row.encoder for row in rows} == {"rbw_osr", "rbw_sr", "rsw_sr", "lsw_sr", "fsw_sr", "lsw_index_sr"}
    assert {row.tests for row in rows if row.encoder == "rbw_osr"} == {("rbw_sr",)}
    assert not any(row.tests for row in rows if row.encoder != "rbw_osr")
    assert [row.bits for row in rows if row.encoder == "rbw_sr"] == [1, 1, 1, 1]


def test_rows_that_decide_claims_come_first_and_have_several_seeds() -> None:
    rows = plan(TABLES, seeds=3)
    assert len(rows) == 30 + 2 * 10
    assert [row.seed for row in rows] == [0] * 10 + [1] * 10 + [0] * 20 + [2] * 10
    assert {row.decoder for row in rows[:10]} == {"e2e_cnn", "res2former"}
    assert {row.name for row in rows[:10]} == {row.name for row in rows[10:20]} == {row.name for row in rows[-10:]}


def test_further_seeds_of_the_other_rows_come_last() -> None:
    rows = plan(TABLES, seeds=3, other_seeds=2)
    assert rows[:50] == plan(TABLES, seeds=3)
    assert [row.seed for row in rows[50:]] == [1] * 20
    assert {row.name for row in rows[50:]} == {row.name for row in rows[20:40]}


def test_a_part_of_the_rows() -> None:
    assert len(plan(TABLES, 1, ["table5"])) == 8
    assert {row.decoder for row in plan(TABLES, 1, ["revsci"])} == {"revsci"}
    assert plan(TABLES, 1, ["lsw_sr_4bit_e2e_cnn"]) == [TableRow("table4", "lsw_sr", 4, "e2e_cnn")]
    assert not plan(TABLES, 1, ["table9"])
    assert {row.name for row in plan(TABLES, 1, ["controls"])} >= {
        "fsw_sr_4bit_e2e_cnn",
        "lsw_index_sr_1bit_res2former",
    }


ROW = TableRow("table2", "rbw_osr", 1, "e2e_cnn", 2, ("rbw_sr",))
ORIGIN = Provenance(machine="an abacus", date="2026-11-22", commit="0123abcd", scale="smoke", seeds="2")
SMOKE = ["row_scale=smoke", "only=[rbw_osr_1bit_e2e_cnn]", "seeds=1", "results=kept"]
QUICK = 'overrides="metrics.qscore=null data.scenes_count=1 logger=none decoder.channels=4"'


def test_what_is_kept(made: Made, tmp_path: Path) -> None:
    """Both tests of a row, its own last; provenance and no place of this machine."""
    run = made("run", "rbw_osr", "e2e_cnn", 30.0).parent
    made("run/test_rbw_sr", "rbw_osr", "e2e_cnn", 25.0, test="rbw_sr")
    for path in (run / "metrics.json", run / "test_rbw_sr" / "metrics.json"):
        content = json.loads(path.read_text())
        content["config"] |= {"out": str(run), "data": {"root": "/home/me/CLIPS"}, "system": {"cuda_graph": False}}
        content["config"]["initialisation"] = "layers"
        path.write_text(json.dumps(content))
    assert not is_kept(ROW, tmp_path / "kept")
    files = keep(ROW, run, tmp_path / "kept", ORIGIN)
    assert is_kept(ROW, tmp_path / "kept") and files == kept_files(ROW, tmp_path / "kept")
    assert [path.relative_to(tmp_path / "kept").as_posix() for path in files] == [
        "rbw_osr_1bit_e2e_cnn/seed2.json",
        "rbw_osr_1bit_e2e_cnn/seed2_rbw_sr.json",
    ]
    for path, psnr in zip(files, (30.0, 25.0), strict=True):
        content = json.loads(path.read_text())
        check("metrics", content)
        assert content["mean"]["psnr"] == psnr and content["provenance"]["commit"] == "0123abcd"
        assert content["config"]["data"] == {"root": "CLIPS"} and str(tmp_path) not in path.read_text()
    check_recipe(ROW, tmp_path / "kept", {"size": [64, 64], "system": {"lr": 1}})  # what only one of them says
    with pytest.raises(BadInput, match=r"size=\[64, 64\].*\[32, 32\]; .*label="):
        check_recipe(ROW, tmp_path / "kept", {"size": [32, 32]})
    with pytest.raises(BadInput, match=r"initialisation=layers, .*unit_variance"):
        check_recipe(ROW, tmp_path / "kept", {"initialisation": "unit_variance"})
    check_recipe(ROW, tmp_path / "kept", {"data": {"root": "/elsewhere/OTHER"}})  # a place is no part of a recipe
    check_recipe(ROW, tmp_path / "kept", {"system": {"cuda_graph": True}})  # nor is what a GPU needs to be fast


@pytest.mark.slow
def test_a_row_is_trained_once(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    done = command("tables.rows", *SMOKE, QUICK)
    assert done.returncode == 0, done.stderr + done.stdout
    assert "1 of 1 rows left" in done.stdout and "kept " in done.stdout
    kept = tmp_path / "kept" / "smoke" / "rbw_osr_1bit_e2e_cnn" / "seed0.json"
    before = kept.stat().st_mtime_ns
    content = json.loads(kept.read_text())
    check("metrics", content)
    assert content["provenance"]["scale"] == "smoke" and 10 < content["mask_score"] < 40
    assert "| E2E-CNN |" in (tmp_path / "outputs/tables_rows/smoke/smoke/tables/table2.md").read_text()
    written = tmp_path / "outputs/tables_rows/smoke/smoke/tables"
    assert not [*written.glob("mosaic*"), *written.glob("retrained*")]  # mosaic=0: no checkpoint is needed
    again = command("tables.rows", *SMOKE, QUICK)
    assert again.returncode == 0 and "0 of 1 rows left" in again.stdout and kept.stat().st_mtime_ns == before
    assert not list((tmp_path / "outputs").rglob(".rows*"))


def test_a_label_that_is_a_path(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    done = command("tables.rows", "label=../elsewhere")
    assert done.returncode == 2 and "expected a name of letters, digits" in done.stderr
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "expected", "folder"),
    [
        (["core_minutes=10", "label=designed"], {"core_minutes=10"}, "cpu_10_minutes_designed"),
        (["steps=5000"], {"core_minutes=null", "trainer.max_steps=5000"}, "cpu_5000_steps"),
    ],
)
def test_another_budget_has_results_of_its_own(
    given: list[str],
    expected: set[str],
    folder: str,
    ran: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    from sci_lightning.cli import command as command_frame
    from sci_lightning.cli import launched_rows
    from sci_lightning.cli.commands import tables_rows as rows

    commands: list[list[str]] = []
    monkeypatch.setattr(launched_rows, "launch_rows", lambda command, task, rows, *_: commands.extend(rows) or [])
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["tables_rows", *given, "only=[rbw_sr_1bit_e2e_cnn]", "seeds=1"])
    command_frame.run("tables_rows", rows.tables_rows)
    (words,) = commands
    assert {*expected, "scale=cpu", "resume=true", "encoder=rbw_sr", "decoder=e2e_cnn", "seed=0"} < set(words)
    assert any(word.startswith("out=") and word.endswith(f"/{folder}") for word in words)


def test_two_budgets(command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    done = command("tables.rows", "steps=5", "core_minutes=1")
    assert done.returncode == 2 and "steps=5 core_minutes=1: give one of them" in done.stderr


def test_a_row_that_is_none(command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    done = command("tables.rows", "only=[table9]")
    assert done.returncode == 2 and "no row is called so" in done.stderr
