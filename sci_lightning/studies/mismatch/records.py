"""The records of the protocol: one JSON file for every camera and decoder, which a later run does not compute again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sci_lightning.files.diagnosis_report import Estimate, Value, Verdict
from sci_lightning.files.json_file import JsonObject, says
from sci_lightning.runs.provenance import Provenance
from sci_lightning.studies.engine.records import CaseRecord, Records, digest_of
from sci_lightning.studies.mismatch.cameras import MismatchedCamera

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


class MismatchRecord(CaseRecord):
    """``cases/CAMERA.DECODER.json``: how well a decoder reconstructs, depending on the camera that it believes in."""

    format: Literal["sci-mismatch"] = "sci-mismatch"
    format_version: Literal[1] = 1
    camera: str
    decoder: str
    provenance: Provenance
    mismatch: dict[str, dict[str, Value]] = says("what the camera has and its model has not: parameters by effect")
    scenarios: dict[ScenarioName, ScenarioScores] = says("those that were computed", min_length=1)
    recovery: dict[DiagnosisKind, float] = says("(IV - II) / (III - II) of the mean PSNR", default={})
    diagnosis: dict[DiagnosisKind, FoundCamera] = says("what the diagnoses found", default={})
    seconds: float = says("of all scenarios, diagnoses included", ge=0)
    sci_lightning: str = says("version of the program")
    settings: dict[str, Any] = says("what else the results depend on")


@dataclass(frozen=True)
class MismatchCase:
    """One camera and one decoder.

    Attributes:
        camera: that records.
        decoder: name of the decoder.
        scenarios: that are asked for; a record may have more.
        bench: digest of the bench.
        settings: what else the results depend on.
    """

    camera: MismatchedCamera
    decoder: str
    scenarios: tuple[str, ...]
    bench: str
    settings: Mapping[str, Any]

    @property
    def name(self) -> str:
        """What its record is called."""
        return f"{self.camera.name}.{self.decoder}"

    @property
    def digest(self) -> str:
        """Digest of everything that the scores depend on; the scenarios are no part of it."""
        return digest_of({"bench": self.bench, "camera": self.camera.mismatch, **self.settings})

    def describe(self) -> dict[str, Any]:
        """Return what its record says of it."""
        about = {"format": "sci-mismatch", "format_version": 1, "camera": self.camera.name, "decoder": self.decoder}
        return {**about, "digest": self.digest, "settings": dict(self.settings)}

    def is_in(self, record: MismatchRecord) -> bool:
        """Whether a record has all scenarios that are asked for."""
        return set(self.scenarios) <= record.scenarios.keys()


def mismatch_records(folder: str | Path) -> Records[MismatchRecord]:
    """Return the records of the protocol in a folder."""
    return Records(Path(folder), MismatchRecord, MismatchCase.is_in)


def read_records(folder: str | Path) -> list[dict[str, Any]]:
    """Return the content of all records in a folder, in the order of their file names; raises BadInput."""
    return [record.as_json() for record in mismatch_records(folder).read()]
