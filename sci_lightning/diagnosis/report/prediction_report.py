"""The files of a diagnosis by held-out pixels alone: report, corrected encoder, effective masks and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure

from sci_lightning import __version__
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.diagnosis.blind.search_by_prediction import UNSEEN, PredictionResult
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera
from sci_lightning.diagnosis.report.blind_page import BlindPage, predicted_errors
from sci_lightning.diagnosis.report.blind_report import CAPTIONS
from sci_lightning.diagnosis.report.corrected_camera import (
    prediction_figure,
    reconstruction_figure,
    write_effective_mask,
)
from sci_lightning.diagnosis.report.digits import quantity, uncertainty
from sci_lightning.diagnosis.report.report_page import Provenance
from sci_lightning.files.atomic_file import atomic_write

JUDGED_BY_PREDICTION = "Held-out pixels alone have judged: the statistics of video do not reach over so many slots."

UNCERTAINTY = (
    "Uncertainties are one standard deviation of the mean over parts of the snapshots, of which each has a best value "
    "of its own. What is the same for all scenes, such as an error of the patterns, comes on top."
)
"""What ``std`` of the report means, for people."""


def write_prediction_report(
    result: PredictionResult, camera: SnapshotCamera, out: str | Path, provenance: Provenance | None = None
) -> None:
    """Write all files into the folder ``out``; none is ever half written.

    Args:
        result: of the search.
        camera: the snapshots.
        out: the folder.
        provenance: what was diagnosed, when and how; None if the report is to say nothing about that.
    """
    out, provenance = Path(out), provenance or Provenance()
    content = describe_prediction(result, camera) | provenance.describe()
    with atomic_write(out / "report.json") as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")
    corrected = camera.encoder(result.values)
    _write_encoder(camera, result, out)
    write_effective_mask(corrected, out)
    shown = int(np.argmax(camera.verification.numpy()))
    drawn = {
        "prediction.png": prediction_figure(result.all_snapshots, camera.numbers, camera.set_aside),
        "reconstruction.png": reconstruction_figure(camera.measurement[shown], camera.encoder({}), corrected),
    }
    for name, figure in drawn.items():
        with atomic_write(out / name) as temporary:
            figure.savefig(temporary, dpi=150, facecolor="white", bbox_inches="tight")
    with atomic_write(out / "report.html") as temporary:
        temporary.write_text(_page(result, camera, drawn).render(provenance), encoding="utf-8")


def prediction_headline(result: PredictionResult, camera: SnapshotCamera) -> str:
    """Return the result in one sentence."""
    judged = result.verification or result.fitted
    where = "snapshots that nothing was fitted to" if result.verification else "the snapshots"
    if not result.mask_is_visible:
        return (
            "Held-out pixels are as predictable without any mask: the snapshots do not show whether this mask is "
            "right, and what seems to be missing only weakens it."
        )
    if not result.effects:
        return f"Held-out pixels of {where} ask for nothing: they are predicted to {judged.after:.3f} of their spread."
    named = " and ".join(_clause(result, camera, name) for name in result.values)
    return (
        f"{named[0].upper()}{named[1:]}: with that the error of held-out pixels of {where} falls from "
        f"{judged.before:.3f} to {judged.after:.3f} of their spread ({judged.agree} of {judged.snapshots} ask for it)."
    )


def print_prediction(result: PredictionResult, camera: SnapshotCamera, console: PlainConsole) -> None:
    """Print the result, and what held-out pixels cannot tell."""
    colour = "green" if result.verdict in ("consistent", "explained") else "yellow"
    console.say(styled(result.verdict.replace("_", " "), f"bold {colour}"), f": {prediction_headline(result, camera)}")
    for effect in result.effects:
        if effect.alternatives:
            console.say(
                f"{effect.name}: or it is {' or '.join(effect.alternatives)}, which cannot be told from it here"
            )
    console.say(f"held-out pixels cannot tell: {', '.join(UNSEEN)}; they look like other scenes")


def describe_prediction(result: PredictionResult, camera: SnapshotCamera) -> dict[str, Any]:
    """Return the content of ``report.json`` without its provenance, as plain data."""
    return {
        "format": "sci-diagnosis",
        "format_version": 2,
        "verdict": result.verdict,
        "effects": [_effect(result, camera, name) for name in result.values],
        "uncertainty": UNCERTAINTY,
        "gap": result.all_snapshots.sides(),
        "unnamed": [],
        "where": {"before": [], "after": []},
        "noise": {"stated_by_the_file": []},
        "next_captures": [],
        "mode": "blind",
        "laboratory": [],
        "undetermined": [{"effect": name, "looks_like": "another scene"} for name in UNSEEN],
        "notes": [
            JUDGED_BY_PREDICTION,
            f"Prediction error without any mask: {result.without_mask.before:.4f}.",
        ],
        "verification": _verification(result, camera),
        "split": {
            "held_out_captures": list(camera.set_aside),
            "fitted_captures": len(camera) - len(camera.set_aside),
            "held_out_blocks": "none: single pixels, blue noise",
            "held_out_fraction": 0.05,
            "held_out": True,
        },
        "seed": result.seed,
        "sci_lightning": __version__,
    }


def _verification(result: PredictionResult, camera: SnapshotCamera) -> dict[str, Any]:
    if result.verification is None:
        return {"captures": [], "note": "no snapshot was set aside: give verification=[..]"}
    gap = result.verification.sides()
    return {"captures": list(camera.set_aside), **gap["after"], "before": gap["before"]}


def _effect(result: PredictionResult, camera: SnapshotCamera, name: str) -> dict[str, Any]:
    effect = next(effect for effect in result.effects if effect.name == name)
    kind = camera.vocabulary[name]
    parameters = {}
    for parameter, about in kind.about.items():
        deviation = effect.deviation.get(parameter, 0.0)
        parameters[parameter] = {
            "value": effect.values[parameter],
            "std": 0.0 if math.isnan(deviation) else deviation,
            "systematic": 0.0,
            "unit": about.unit,
        }
    return {
        "name": name,
        "stage": kind.stage,
        "parameters": parameters,
        "evidence": {"agree": [effect.evidence.agree, effect.evidence.snapshots], "p_value": effect.evidence.p_value},
        "alternatives": list(effect.alternatives),
        "tell_apart": "",
    }


def _clause(result: PredictionResult, camera: SnapshotCamera, name: str) -> str:
    effect = next(effect for effect in result.effects if effect.name == name)
    values = {
        parameter: quantity(value, 0.0 if math.isnan(std := effect.deviation.get(parameter, 0.0)) else std, 1e-3)
        for parameter, value in effect.values.items()
    }
    return camera.vocabulary[name].describe(values)


def _write_encoder(camera: SnapshotCamera, result: PredictionResult, out: Path) -> None:
    """Write ``encoder.yaml`` and the patterns that it names."""
    with atomic_write(out / "patterns.npy") as temporary:
        np.save(temporary, camera.patterns.numpy().astype(np.float32))
    slots, (height, width) = len(camera.patterns), camera.size
    effects = {
        name: {"_target_": f"{camera.vocabulary[name].__module__}.{camera.vocabulary[name].__qualname__}", **values}
        for name, values in result.values.items()
    }
    mask = {"file": "patterns.npy", "key": None, "frames": slots, "size": [height, width]}
    content = {
        "_target_": "sci_lightning.encoder.Encoder",
        "aperture": "auto",
        "mask": {"_target_": "sci_lightning.encoder.mask.Measured", **mask},
        "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise", "bit_depth": camera.bit_depth},
        "effects": effects,
    }
    with atomic_write(out / "encoder.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def _page(result: PredictionResult, camera: SnapshotCamera, drawn: Mapping[str, Figure]) -> BlindPage:
    height, width = camera.size
    return BlindPage(
        verdict=result.verdict,
        names=tuple(result.values),
        headline=prediction_headline(result, camera),
        about=f"{len(camera)} snapshots, {height} x {width} pixels, {len(camera.patterns)} slots, "
        f"{camera.bit_depth} bits",
        notes=(JUDGED_BY_PREDICTION,),
        rows=_rows(result, camera),
        uncertainty=UNCERTAINTY,
        predicted=predicted_errors(result.all_snapshots, result.without_mask, result.verification),
        figures={CAPTIONS[name]: figure for name, figure in drawn.items()},
        advice=(),
        undetermined=dict.fromkeys(UNSEEN, "another scene"),
        remark="Nobody has looked for deviations without a name.",
    )


def _rows(result: PredictionResult, camera: SnapshotCamera) -> list[tuple[str, ...]]:
    """Return the texts of every parameter, as the page has them."""
    rows: list[tuple[str, ...]] = []
    for effect in result.effects:
        kind = camera.vocabulary[effect.name]
        for name, about in kind.about.items():
            deviation = effect.deviation.get(name, 0.0)
            known = 0.0 if math.isnan(deviation) else deviation
            error = uncertainty(known)
            value = quantity(effect.values[name], known, 1e-3).split(" ")[0]
            agree = f"{effect.evidence.agree} of {effect.evidence.snapshots}"
            unit = "" if about.unit == "1" else about.unit
            others = ", ".join(effect.alternatives)
            rows.append((effect.name, kind.stage, name, value, error and f"\u00b1 {error}", unit, agree, others))
    return rows
