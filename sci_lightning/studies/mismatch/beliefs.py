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
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_fields import read_json
from sci_lightning.runs.encoder_file import read_encoder_file
from sci_lightning.studies.mismatch.bench import Bench
from sci_lightning.studies.mismatch.cameras import Mismatch, MismatchedCamera

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
    kept = read_json(about).content if about.is_file() else {}
    if kept.get("digest") != digest:
        if kind == "calibrated":
            captures = bench.calibration(camera.mismatch)
        else:
            captures = bench.snapshots(measurement, snapshots)
        about.unlink(missing_ok=True)
        kept = {"digest": digest, **_diagnose(kind, captures, folder, on_progress)}
        with atomic_write(about) as temporary:  # last: it says that the others are whole
            temporary.write_text(json.dumps(kept, indent=1) + "\n")
    path = folder / "encoder.yaml"
    encoder: Encoder = build_from_file(read_encoder_file(path).content, path, "encoder")
    return encoder, {key: value for key, value in kept.items() if key != "digest"}


def _diagnose(kind: str, captures: Captures, folder: Path, on_progress: Progress) -> dict[str, Any]:
    """Diagnose captures, write ``encoder.yaml`` and ``report.json``; return what records say of it."""
    from sci_lightning.diagnosis import diagnose
    from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
    from sci_lightning.diagnosis.report.blind_report import write_blind_report
    from sci_lightning.diagnosis.report.report import describe, write_encoder

    start, cpu_start = time.perf_counter(), time.process_time()
    if kind == "blind":
        write_blind_report(diagnose_blind(captures, on_progress=on_progress), folder)
        report: dict[str, Any] = dict(read_json(folder / "report.json").content)
    else:
        diagnosis = diagnose(captures, on_progress=on_progress)
        report = describe(diagnosis)
        write_encoder(diagnosis, folder)
        with atomic_write(folder / "report.json") as temporary:
            temporary.write_text(json.dumps(report, indent=1) + "\n")
    return {
        "verdict": report["verdict"],
        "captures": len(captures),
        "effects": [{"name": effect["name"], "parameters": effect["parameters"]} for effect in report["effects"]],
        "seconds": time.perf_counter() - start,
        "cpu_seconds": time.process_time() - cpu_start,
    }
