"""Every format that is written as JSON has one model: it reads what was written, writes it again, yields a schema."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from sci_lightning.files.json_file import read_json
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.mismatch.records import MismatchRecord
from sci_lightning.studies.tables.documented import Measurements
from sci_lightning.virtual_camera import Session, VirtualCamera
from sci_lightning.virtual_camera.truth import Truth
from tests.conftest import ROOT
from tests.files.formats import MODELS, check

KEPT = {"sci-metrics": RunMetrics, "sci-mismatch": MismatchRecord, "sci-measurements": Measurements}


@pytest.mark.parametrize("name", MODELS)
def test_a_model_yields_a_schema(name: str) -> None:
    schema = TypeAdapter(MODELS[name]).json_schema()
    assert all(one.get("description") for one in [schema, *schema.get("$defs", {}).values()] if "properties" in one)


def test_kept_results_are_written_again_byte_for_byte() -> None:
    formats = set()
    for path in sorted((ROOT / "docs" / "results").rglob("*.json")):
        text = path.read_text(encoding="utf-8")
        content = json.loads(text)
        if isinstance(content, dict) and (model := KEPT.get(content.get("format", ""))):
            written = read_json(path, model).as_json()
            assert written == content, path
            if path.is_relative_to(ROOT / "docs" / "results" / "tables" / "cpu_4000_steps"):  # as a command left them
                assert json.dumps(written, indent=1) + "\n" == text, path
            formats.add(content["format"])
    assert formats == set(KEPT)


def test_what_is_required_and_what_has_no_place(tmp_path: Path) -> None:
    truth = VirtualCamera(Session(size=(16, 16), frames=2), {"prnu": {}}).write(tmp_path / "a.h5", seed=1)
    content = json.loads(truth.read_text())
    check("captures_truth", content)
    assert json.dumps(Truth(**content).as_json(), indent=2) + "\n" == truth.read_text()
    for wrong in ({"more": 1}, {"format_version": 2}, {"effects": None}, {"session": {"frames": 0}}):
        with pytest.raises(ValidationError):
            Truth.model_validate_json(json.dumps(content | wrong), strict=True)
