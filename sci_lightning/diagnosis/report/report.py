"""The files of a diagnosis: ``report.json``, ``report.html``, pictures and ``encoder.yaml``.

Everything here reads a :class:`~sci_lightning.diagnosis.diagnosis.Result`; nothing is fitted or computed anew.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from matplotlib.figure import Figure

from sci_lightning.diagnosis.model.camera_model import CameraModel, Setting
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.report.pictures import figures
from sci_lightning.diagnosis.report.report_page import Provenance, report_page
from sci_lightning.diagnosis.report.sentences import class_paths
from sci_lightning.diagnosis.result import Result
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.encoder.free_form import FreeForm
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.version import installed_version

UNCERTAINTY = (
    "Uncertainties are statistical only: one standard deviation, from the noise of the captures. Systematic errors, of "
    "the target, of the light or of the patterns as displayed, come on top. Digits beyond a thousandth of what an "
    "effect changes are not shown, because no formula is trusted further."
)
"""What ``std`` and ``systematic`` of the report mean, for people."""

VERIFIED_BY_NONE: dict[str, Any] = {
    "captures": [],
    "note": "no capture was kept for verification; the verdict rests on held-out pixels",
}
"""What ``verification`` says in ``report.json`` if there is none."""


def write_report(
    diagnosis: Result,
    out: str | Path,
    provenance: Provenance | None = None,
    drawn: Mapping[str, Figure] | None = None,
) -> None:
    """Write all files of a diagnosis into the folder ``out``; none is ever half written.

    Args:
        diagnosis: the result.
        out: the folder; created if it does not exist.
        provenance: what was diagnosed, when and how; None if the report is to say nothing about that.
        drawn: the figures by file name; None to draw them.
    """
    out, drawn = Path(out), figures(diagnosis) if drawn is None else drawn
    provenance = provenance or Provenance()
    with atomic_write(out / "report.json") as temporary:
        temporary.write_text(json.dumps(describe(diagnosis) | provenance.describe(), indent=1) + "\n")
    write_encoder(diagnosis, out)
    for name, figure in drawn.items():
        with atomic_write(out / name) as temporary:
            figure.savefig(temporary, dpi=150, facecolor="white", bbox_inches="tight")  # no label is cut off
    with atomic_write(out / "report.html") as temporary:
        temporary.write_text(report_page(diagnosis, provenance, drawn, UNCERTAINTY), encoding="utf-8")


def describe(diagnosis: Result) -> dict[str, Any]:
    """Return the content of ``report.json`` without its provenance, as plain data; the schema describes every field."""
    assessments = {"before": diagnosis.before, "after": diagnosis.after}
    effects = diagnosis.after.fit.hypothesis.effects
    noise = {name: values for name, values in effects.items() if diagnosis.model.effects[name].noise}
    unknown = diagnosis.unknown_scenes
    return {
        "format": "sci-diagnosis",
        "format_version": 2,
        "verdict": diagnosis.verdict,
        "effects": [effect.describe() for effect in diagnosis.camera],
        "uncertainty": UNCERTAINTY,
        "gap": {when: assessment.gap.describe() for when, assessment in assessments.items()},
        "unnamed": [
            {
                "stage": unnamed.stage,
                "where": unnamed.where,
                "p_value": unnamed.p_value,
                "nats": unnamed.nats,
                "picture": f"unnamed_{number}.png",
            }
            for number, unnamed in enumerate(diagnosis.unnamed, start=1)
        ],
        "where": {when: [test.describe() for test in model.tests] for when, model in assessments.items()},
        "noise": {**noise, "stated_by_the_file": list(diagnosis.stated_noise)},
        "considered": class_paths(diagnosis.considered),
        "next_captures": list(diagnosis.next_captures),
        "mode": "calibrated",
        "laboratory": [effect.describe() for effect in diagnosis.laboratory],
        "verification": VERIFIED_BY_NONE if diagnosis.verification is None else diagnosis.verification.describe(),
        "bad_captures": [capture.describe() for capture in diagnosis.bad_captures],
        **({} if unknown is None else {"unknown_scenes": unknown.describe()}),
        "split": diagnosis.split.describe(),
        "seed": diagnosis.seed,
        "sci_lightning": installed_version(),
    }


def write_encoder(diagnosis: Result, out: str | Path) -> None:
    """Write the corrected encoder: ``encoder.yaml``, and beside it the patterns and maps that it names."""
    hypothesis = diagnosis.after.fit.hypothesis
    write_corrected_encoder(diagnosis.observation, diagnosis.model, hypothesis.effects, hypothesis.maps, out)


def write_corrected_encoder(
    observation: Observation,
    model: CameraModel,
    settings: Mapping[str, Setting],
    maps: Mapping[str, torch.Tensor],
    out: str | Path,
) -> None:
    """Write an encoder with the effects of a hypothesis: ``encoder.yaml``, and the patterns and maps that it names.

    Args:
        observation: captures, of which the patterns are taken.
        model: knows the effects' classes.
        settings: values by parameter, by effect.
        maps: fixed-pattern maps by effect.
        out: the folder.
    """
    out = Path(out)
    distinct = torch.tensor([len(set(sequence.tolist())) for sequence in observation.sequences])
    patterns = observation.patterns[observation.sequences[distinct.argmax()]].numpy()
    slots, (height, width) = len(patterns), observation.size
    _save(out / "patterns.npy", patterns)
    effects: dict[str, Any] = {}
    for name, values in settings.items():
        effect = model.effects[name]
        if (issubclass(effect, FreeForm) and effect.of_captures) or issubclass(effect, SceneEffect):
            continue
        effects[name] = {"_target_": f"{effect.__module__}.{effect.__qualname__}", **values}
        if issubclass(effect, FreeForm):
            effects[name]["count"] = effect.count
        if effect.map_kind and name in maps:
            scale = float(values["std"]) if "std" in values else 1.0
            _save(out / f"{name}.npy", (maps[name] / max(scale, 1e-12)).numpy())
            effects[name] |= {"file": f"{name}.npy", "size": [height, width]}
    mask = {"file": "patterns.npy", "key": None, "frames": slots, "size": list(patterns.shape[1:])}
    content: dict[str, Any] = {
        "_target_": "sci_lightning.encoder.Encoder",
        "aperture": "auto",
        "mask": {"_target_": "sci_lightning.encoder.mask.Measured", **mask},
        "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise", "bit_depth": observation.bit_depth},
        "effects": effects,
    }
    if observation.grid is not None:
        content["sensor_to_modulator"] = observation.grid.sensor_to_modulator.tolist()
        content["size"] = [height, width]
    with atomic_write(out / "encoder.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def _save(path: Path, array: np.ndarray) -> None:
    with atomic_write(path) as temporary:
        np.save(temporary, array.astype(np.float32))
