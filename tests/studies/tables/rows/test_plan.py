"""The trainings that the paper's tables need, and their order."""

from __future__ import annotations

from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.rows.plan import TableRow, plan

TABLES = paper_figures()["tables"]


def test_every_row_of_the_tables_is_trained_once() -> None:
    rows = plan(TABLES, seeds=1)
    assert len(rows) == len(set(rows)) == 7 + 4 + 5 + 4 + 3  # Tables 2, 3, 4; 5 random; 5 learned without 4 bits
    assert {row.encoder for row in rows} == {"rbw_osr", "rbw_sr", "rsw_sr", "lsw_sr"}
    assert {row.tests for row in rows if row.encoder == "rbw_osr"} == {("rbw_sr",)}
    assert not any(row.tests for row in rows if row.encoder != "rbw_osr")
    assert [row.bits for row in rows if row.encoder == "rbw_sr"] == [1, 1, 1, 1]


def test_rows_that_decide_claims_come_first_and_have_several_seeds() -> None:
    rows = plan(TABLES, seeds=3)
    assert len(rows) == 23 + 2 * 7
    assert [row.seed for row in rows] == [0] * 7 + [1] * 7 + [0] * 16 + [2] * 7
    assert {row.decoder for row in rows[:7]} == {"e2e_cnn", "res2former"}
    assert {row.name for row in rows[:7]} == {row.name for row in rows[7:14]} == {row.name for row in rows[-7:]}


def test_further_seeds_of_the_other_rows_come_last() -> None:
    rows = plan(TABLES, seeds=3, other_seeds=2)
    assert rows[:37] == plan(TABLES, seeds=3)
    assert [row.seed for row in rows[37:]] == [1] * 16
    assert {row.name for row in rows[37:]} == {row.name for row in rows[14:30]}


def test_a_part_of_the_rows() -> None:
    assert len(plan(TABLES, 1, ["table5"])) == 8
    assert {row.decoder for row in plan(TABLES, 1, ["revsci"])} == {"revsci"}
    assert plan(TABLES, 1, ["lsw_sr_4bit_e2e_cnn"]) == [TableRow("table4", "lsw_sr", 4, "e2e_cnn")]
    assert not plan(TABLES, 1, ["table9"])
