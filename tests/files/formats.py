"""Files of our formats, which tests make anyway, compared with the models of these formats."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, TypeAdapter

from sci_lightning.files.diagnosis_report import DiagnosisReport, SnapshotFacts
from sci_lightning.files.json_file import JsonFile
from sci_lightning.files.modulator_files import Planes
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.benchmark.benchmark_file import Benchmark
from sci_lightning.studies.engine import FailedCase
from sci_lightning.studies.mismatch.records import MismatchRecord
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.report import Summary
from sci_lightning.studies.tables.documented import Measurements
from sci_lightning.virtual_camera.truth import Truth

MODELS: Mapping[str, Any] = {
    "benchmark": Benchmark,
    "captures_truth": Truth,
    "mask_planes": Planes,
    "measurements": Measurements,
    "metrics": RunMetrics,
    "mismatch": MismatchRecord,
    "failed_case": FailedCase,
    "proving_ground_case": Outcome,
    "proving_ground_summary": Summary,
    "report": DiagnosisReport,
    "snapshots": SnapshotFacts,
}


def check(name: str, content: Any) -> None:
    """Fail unless ``content`` is what the model of this name reads, and what it writes again."""
    model: BaseModel = TypeAdapter(MODELS[name]).validate_json(json.dumps(content), strict=True)
    assert isinstance(model, JsonFile)
    assert json.loads(json.dumps(model.as_json())) == json.loads(json.dumps(content))
