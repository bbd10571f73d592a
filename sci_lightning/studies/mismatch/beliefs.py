"""What a decoder believes about the camera: the ideal one, the true one, or the one that a diagnosis found."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.configuration.build import build_from_file
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.mask import Measured
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json, write_json
from sci_lightning.runs.encoder_file import read_encoder_file
from sci_lightning.studies.mismatch.bench import Bench
from sci_lightning.studies.mismatch.cameras import Mismatch, MismatchedCamera
from sci_lightning.studies.mismatch.records import FoundCamera, KeptDiagnosis

Progress = Callable[[str], None]
"""Is called with a line of news."""


def ideal_camera(bench: Bench) -> Encoder:
    """Return the camera without any effect, which a user believes in who has not looked."""
    return _encoder(bench, {})


def true_camera(bench: Bench, mismatch: Mismatch) -> Encoder:
    """Return the encoder with the camera's true effects.

    Raises:
        BadInput: an effect that the encoder does not have.
    """
    return _encoder(bench, mismatch)


def encoder_effects(mismatch: Mismatch) -> list[Effect]:
    """Return a mismatch as effects of the encoder; raises BadInput for one that the encoder does not have."""
    classes = vocabulary()
    if unknown := [name for name in mismatch if name not in classes]:
        raise BadInput(f"mismatch.{unknown[0]}: the encoder has no such effect, so that no decoder can know it")
    return [classes[name](**values) for name, values in mismatch.items()]


def _encoder(bench: Bench, mismatch: Mismatch) -> Encoder:
    mask, sensor = Measured(bench.session.mask), ClipQuantise(bench.session.bit_depth)
    return Encoder(mask, sensor, bench.aperture, encoder_effects(mismatch))


def diagnosed_camera(
    bench: Bench,
    camera: MismatchedCamera,
    kind: str,
    measurement: np.ndarray,
    snapshots: int,
    folder: str | Path,
    on_progress: Progress,
) -> tuple[Encoder, dict[str, Any]]:
    """Return the encoder that a diagnosis found, and what is recorded of that diagnosis; it is made only once.

    Args:
        bench: gives the captures.
        camera: that is diagnosed.
        kind: ``calibrated``, from calibration captures of the same camera, or ``blind``, from the snapshots alone.
        measurement: the camera's snapshots of the scenes, raw DN (N, H, W).
        snapshots: how many of them a blind diagnosis sees at most.
        folder: of all cameras; the diagnosis is kept in ``<camera>/<kind>/``.
        on_progress: called with a one-line message about what the search does.
    """
    folder = Path(folder) / camera.name / kind
    about = folder / "diagnosis.json"
    digest = f"{bench.digest} {json.dumps(camera.mismatch, sort_keys=True)}" + (
        f" {snapshots}" if kind == "blind" else ""
    )
    kept = read_json(about, KeptDiagnosis) if about.is_file() else None
    if kept is None or kept.digest != digest:
        if kind == "calibrated":
            captures = bench.calibration(camera.mismatch)
        else:
            captures = bench.snapshots(measurement, snapshots)
        about.unlink(missing_ok=True)
        content = {"digest": digest, **_diagnose(kind, captures, folder, on_progress)}
        write_json(content, about)  # last: it says that the others are whole
        kept = KeptDiagnosis(**content)
    path = folder / "encoder.yaml"
    encoder: Encoder = build_from_file(read_encoder_file(path).content, path, "encoder")
    return encoder, kept.model_dump(include=set(FoundCamera.model_fields), exclude_unset=True)


def _diagnose(kind: str, captures: Captures, folder: Path, on_progress: Progress) -> dict[str, Any]:
    """Diagnose captures, write ``encoder.yaml`` and ``report.json``; return what records say of it."""
    from sci_lightning.diagnosis import diagnose
    from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
    from sci_lightning.diagnosis.report.corrected_camera import write_encoder
    from sci_lightning.diagnosis.report.report import describe, write_report

    start, cpu_start = time.perf_counter(), time.process_time()
    if kind == "blind":
        write_report(diagnose_blind(captures, on_progress=on_progress), folder)
        report = json.loads((folder / "report.json").read_text())
    else:
        diagnosis = diagnose(captures, on_progress=on_progress)
        report = describe(diagnosis)
        write_encoder(diagnosis, folder)
        write_json(report, folder / "report.json")
    return {
        "verdict": report["verdict"],
        "captures": len(captures),
        "effects": [{"name": effect["name"], "parameters": effect["parameters"]} for effect in report["effects"]],
        "seconds": time.perf_counter() - start,
        "cpu_seconds": time.process_time() - cpu_start,
    }
