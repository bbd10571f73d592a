"""The tables of the documentation that are generated from a proving ground's folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import write_json
from sci_lightning.studies.engine import Records
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.report import as_plain_data, provenance_of, write_report
from sci_lightning.studies.proving_ground.summary import summarise
from sci_lightning.studies.tables.documented import proving_ground as build
from tests.conftest import ROOT
from tests.files.formats import check

WHERE = {"provenance": {"machine": "an abacus", "date": "2026-11-22", "commit": "0123abcd"}}
KEPT = sorted((ROOT / "docs" / "results" / "proving_ground").glob("*/"))
"""Folders of cases that are published."""


@pytest.fixture
def folder(tmp_path: Path, record: Callable[..., Any]) -> Path:
    fatter = {"brighter_fatter": {"strength": 0.05}}
    contents = [
        record("outside", fatter, {}, unnamed=("sensor", "optics"), verdict="unexplained", case="a", **WHERE),
        record("outside", {"ghost": {"fraction": 0.1}}, {}, unnamed=("optics",), case="b", **WHERE),
        record("nothing", {}, {}, formulation="rays", unnamed=("exposure",), verdict="unexplained", case="c", **WHERE),
        record("nothing", {}, {"gain": {"factor": (1.1, 0.01)}}, formulation="rays", case="d", **WHERE),
    ]
    for content in contents:
        write_json({**content, "digest": content["case"]}, tmp_path / "cases" / f"{content['case']}.json")
    records = Records(tmp_path / "cases", Outcome).read()
    write_report(tmp_path, summarise(records), provenance_of(records, "python -m sci_lightning.proving_ground"))
    check("proving_ground_summary", json.loads((tmp_path / "summary.json").read_text()))
    return tmp_path


def test_tables(folder: Path) -> None:
    outside = build(folder, "outside")
    camera = "structural, 8 bits"
    assert outside.rows == [["`brighter_fatter`", camera, "", "sensor, optics", "", "unexplained", "10", "1"]]
    assert [row[:3] for row in build(folder, "rays").rows] == [["nothing", camera, "`gain`"]]  # others are right
    summary = build(folder, "summary").as_markdown()
    assert "| outside the vocabulary: any wrong name | 0.0% (0 of 2; 0% to 66%) | at most 5% | yes |" in summary
    assert "an abacus; 2026-11-22; commit 0123abcd; scale: 4 cases of 64 x 64 pixels" in summary


def test_no_cases_yet(tmp_path: Path) -> None:
    assert "Not yet run." in build(tmp_path / "later", "summary").as_markdown()


def test_another_part(folder: Path) -> None:
    with pytest.raises(BadInput, match=r"choose proving_ground\.summary"):
        build(folder, "inside")


@pytest.mark.parametrize("kept", KEPT, ids=lambda kept: kept.name)
def test_kept_summaries_are_those_of_their_cases(kept: Path) -> None:
    """What is published follows from the cases beside it, which follow the schema and say how to make them again."""
    for path in (kept / "cases").glob("*.json"):
        content = json.loads(path.read_text())
        check("proving_ground_case", content)
        assert f"seed={content['seed']}" in content["command"] and path.stem == content["case"]
    records = Records(kept / "cases", Outcome)
    summary = json.loads((kept / "summary.json").read_text())
    check("proving_ground_summary", summary)
    rows = summarise([*records.read(), *records.failures()])
    assert json.loads(json.dumps([as_plain_data(row) for row in rows])) == summary["rows"]
