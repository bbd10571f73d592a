"""The records of the protocol: one JSON file for every camera and decoder, which a later run does not compute again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from sci_lightning.errors import BadInput
from sci_lightning.files.diagnosis_report import Estimate, Value, Verdict
from sci_lightning.files.json_file import JsonFile, JsonObject, read_json, says, write_json
from sci_lightning.runs.provenance import Provenance

ScenarioName = Literal["ideal", "ideal_noisy", "mismatched", "known", "calibrated", "blind"]
"""A key of :data:`~sci_lightning.studies.mismatch.scenarios.SCENARIOS`."""
DiagnosisKind = Literal["calibrated", "blind"]
"""Of calibration captures, or of the snapshots alone."""


class SceneScores(JsonObject):
    """Scores of one scene, or their mean."""

    psnr: float = says("dB")
    ssim: float
    psnr_up_to_gain: float = says("dB after the best factor common to all reconstructions of a camera", default=0)


class ScenarioScores(JsonObject):
    """Scores of one scenario."""

    mean: SceneScores
    scenes: dict[str, SceneScores]


class FoundEffect(JsonObject):
    """An effect that a diagnosis named."""

    name: str
    parameters: dict[str, Estimate]


class FoundCamera(JsonObject):
    """What a diagnosis found."""

    verdict: Verdict
    captures: int = says("that were diagnosed", ge=1)
    effects: list[FoundEffect]
    seconds: float
    cpu_seconds: float = says("seconds of a processor", default=0)


class KeptDiagnosis(FoundCamera):
    """``diagnosis.json`` beside the report of a diagnosis that is not made again."""

    digest: str = says("of the bench and the camera")


class MismatchRecord(JsonFile):
    """``cases/CAMERA.DECODER.json``: how well a decoder reconstructs, depending on the camera that it believes in."""

    format: Literal["sci-mismatch"] = "sci-mismatch"
    format_version: Literal[1] = 1
    camera: str
    decoder: str
    digest: str = says("of everything that the results depend on; with another one it is computed anew")
    provenance: Provenance
    mismatch: dict[str, dict[str, Value]] = says("what the camera has and its model has not: parameters by effect")
    scenarios: dict[ScenarioName, ScenarioScores] = says("those that were computed", min_length=1)
    recovery: dict[DiagnosisKind, float] = says("(IV - II) / (III - II) of the mean PSNR", default={})
    diagnosis: dict[DiagnosisKind, FoundCamera] = says("what the diagnoses found", default={})
    seconds: float = says("of all scenarios, diagnoses included", ge=0)
    sci_lightning: str = says("version of the program")
    settings: dict[str, Any] = says("what else the results depend on")


def record_path(folder: str | Path, camera: str, decoder: str) -> Path:
    """Return the file of a camera and a decoder."""
    return Path(folder) / f"{camera}.{decoder}.json"


def record_digest(settings: Mapping[str, Any]) -> str:
    """Return the digest of everything that a record depends on."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()[:16]


def read_record(path: str | Path) -> dict[str, Any]:
    """Return the content of a record.

    Raises:
        BadInput: the file is no record of this format.
    """
    try:
        return read_json(path, MismatchRecord).as_json()
    except BadInput as error:
        raise BadInput(f"{error}; not a record of the mismatch protocol, move it") from error


def read_records(folder: str | Path) -> list[dict[str, Any]]:
    """Return all records in a folder, in the order of their file names; raises as :func:`read_record`."""
    return [read_record(path) for path in sorted(Path(folder).glob("[!.]*.json"))]


def earlier_record(path: str | Path, digest: str, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the record at ``path``, None if there is none.

    Args:
        path: of the record.
        digest: of everything that a record depends on.
        settings: that the record would have now, for the message.

    Raises:
        BadInput: it was made with other settings, and would be lost.
    """
    path = Path(path)
    if not path.is_file():
        return None
    record = read_record(path)
    if record["digest"] != digest:
        now = json.loads(json.dumps(dict(settings), default=str))
        before = record.get("settings", {})
        changed = [f"{key}={before.get(key)}, now {now.get(key)}" for key in now if before.get(key) != now.get(key)]
        reason = changed[0] if changed else "other scenes, another mask or another camera"
        raise BadInput(f"{path}: made with other settings ({reason}), and would be overwritten; give another out=")
    return record


def write_record(
    path: str | Path, camera: str, decoder: str, digest: str, settings: Mapping[str, Any], results: Mapping[str, Any]
) -> dict[str, Any]:
    """Write a record whole or not at all, and return it."""
    about = {"format": "sci-mismatch", "format_version": 1, "camera": camera, "decoder": decoder, "digest": digest}
    record = {**about, **results, "settings": dict(settings)}
    write_json(record, path)
    return record
