"""The summary that a proving ground leaves beside its cases follows its schema, and says what was found where."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sci_lightning.files.json_file import write_json
from sci_lightning.studies.engine import Records
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.report import provenance_of, write_report
from sci_lightning.studies.proving_ground.summary import summarise
from tests.files.formats import check

WHERE = {"provenance": {"machine": "an abacus", "date": "2026-11-22", "commit": "0123abcd"}}


def test_a_summary(tmp_path: Path, record: Callable[..., Any]) -> None:
    fatter = {"brighter_fatter": {"strength": 0.05}}
    contents = [
        record("outside", fatter, {}, unnamed=("sensor", "optics"), verdict="unexplained", case="a", **WHERE),
        record("outside", {"ghost": {"fraction": 0.1}}, {}, unnamed=("optics",), case="b", **WHERE),
        record("nothing", {}, {}, formulation="rays", unnamed=("exposure",), verdict="unexplained", case="c", **WHERE),
    ]
    for content in contents:
        write_json({**content, "digest": content["case"]}, tmp_path / "cases" / f"{content['case']}.json")
    records = Records(tmp_path / "cases", Outcome).read()
    write_report(tmp_path, summarise(records), provenance_of(records, "python -m sci_lightning.proving_ground"))
    summary = json.loads((tmp_path / "summary.json").read_text())
    check("proving_ground_summary", summary)
    (wrong,) = (row for row in summarise(records) if row.what == "outside the vocabulary: any wrong name")
    assert wrong.figure.startswith("0.0% (0 of 2") and len(summary["rows"]) == len(summarise(records))
    assert summary["provenance"]["machine"] == "an abacus" and summary["provenance"]["commit"] == "0123abcd"
