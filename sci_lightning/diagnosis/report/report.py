"""The files of a diagnosis: ``report.json``, ``report.html``, pictures, ``encoder.yaml`` and effective masks.

Everything here reads a :class:`~sci_lightning.diagnosis.result.Result`, of known or unknown scenes; nothing is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.report.corrected_camera import encoder_of, write_effective_mask, write_encoder
from sci_lightning.diagnosis.report.pictures import figures
from sci_lightning.diagnosis.report.report_page import ReportProvenance, report_page
from sci_lightning.diagnosis.report.sentences import UNCERTAINTY, class_paths
from sci_lightning.diagnosis.result import CalibratedResult
from sci_lightning.encoder.effects import Effect
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.provenance import installed_version

VERIFIED_BY_NONE: dict[str, Any] = {
    "captures": [],
    "note": "no capture was kept for verification; the verdict rests on held-out pixels",
}
"""What ``verification`` says in ``report.json`` if there is none."""


def write_report(
    result: CalibratedResult | BlindDiagnosis,
    out: str | Path,
    provenance: ReportProvenance | None = None,
    drawn: Mapping[str, Figure] | None = None,
) -> None:
    """Write all files of a diagnosis into the folder ``out``; none is ever half written.

    Args:
        result: of the diagnosis.
        out: the folder; created if it does not exist.
        provenance: what was diagnosed, when and how; None if the report is to say nothing about that.
        drawn: the figures by file name; None to draw them.
    """
    out, drawn = Path(out), figures(result) if drawn is None else drawn
    provenance = provenance or ReportProvenance()
    write_json(describe(result) | provenance.describe(), out / "report.json")
    write_encoder(result, out)
    if isinstance(result, BlindDiagnosis) and result.effects and result.predicted is not None:
        write_effective_mask(encoder_of(result.observation, result.model.path(result.hypothesis)), out)
    for name, figure in drawn.items():
        with atomic_write(out / name) as temporary:
            figure.savefig(temporary, dpi=150, facecolor="white", bbox_inches="tight")  # no label is cut off
    with atomic_write(out / "report.html") as temporary:
        temporary.write_text(report_page(result, provenance, drawn), encoding="utf-8")


def describe(result: CalibratedResult | BlindDiagnosis) -> dict[str, Any]:
    """Return the content of ``report.json`` without its provenance, as plain data."""
    noise = {
        name: values for name, values in result.hypothesis.effects.items() if _is_noise(result.model.effects[name])
    }
    return {
        "format": "sci-diagnosis",
        "format_version": 3,
        "verdict": result.verdict,
        "effects": [effect.describe() for effect in result.camera_effects],
        "uncertainty": UNCERTAINTY[result.mode],
        "noise": {**noise, "stated_by_the_file": list(result.stated_noise)},
        "considered": class_paths(result.considered),
        "next_captures": list(result.next_captures),
        "mode": result.mode,
        "laboratory": [effect.describe() for effect in result.laboratory],
        **(_of_unknown_scenes(result) if isinstance(result, BlindDiagnosis) else _of_known_scenes(result)),
        "seed": result.seed,
        "sci_lightning": installed_version(),
    }


def _is_noise(effect: type[Effect]) -> bool:
    """Return whether an effect is noise of the camera."""
    return effect.noise and not effect.of_captures


def _of_known_scenes(result: CalibratedResult) -> dict[str, Any]:
    """Return what only ``report.json`` of captures with known scenes says, or says in other numbers."""
    assessments = {"before": result.before, "after": result.after}
    unknown = result.unknown_scenes
    return {
        "budget": {
            "allowed_s": result.budget.seconds,
            "used_s": result.budget.used,
            "not_tried": list(result.budget.not_tried),
        },
        "gap": {when: assessment.gap.describe() for when, assessment in assessments.items()},
        "unnamed": [
            {
                "stage": unnamed.stage,
                "where": unnamed.where,
                "p_value": unnamed.p_value,
                "nats": unnamed.nats,
                "probability": unnamed.probability,
                "picture": f"unnamed_{number}.png",
            }
            for number, unnamed in enumerate(result.unnamed, start=1)
        ],
        "where": {when: [test.describe() for test in model.tests] for when, model in assessments.items()},
        "verification": VERIFIED_BY_NONE if result.verification is None else result.verification.describe(),
        "bad_captures": [capture.describe() for capture in result.bad_captures],
        "not_named": dict(result.not_named),
        "imperfections": [error.describe() for error in result.imperfections],
        **({} if unknown is None else {"unknown_scenes": unknown.describe()}),
        "split": result.split.describe(),
    }


def _of_unknown_scenes(result: BlindDiagnosis) -> dict[str, Any]:
    """Return what only ``report.json`` of snapshots of unknown scenes says, or says in other numbers."""
    judged = result.prediction
    errors: dict[str, dict[str, Any]] = {"before": {}, "after": {}} if judged is None else judged.gap.sides()
    verification = VERIFIED_BY_NONE
    if judged is not None and judged.verification is not None:
        sides = judged.verification.sides()
        verification = {"captures": list(result.verification), **sides["after"], "before": sides["before"]}
    return {
        "gap": {
            "before": _nats_per_pixel(result.ideal.log_likelihood.numpy()) | errors["before"],
            "after": _nats_per_pixel(result.corrected.log_likelihood.numpy()) | errors["after"],
        },
        "unnamed": [],
        "where": {"before": [], "after": []},
        "undetermined": [{"effect": name, "looks_like": why} for name, why in result.undetermined.items()],
        "notes": list(result.notes),
        "without_mask": {"gained": result.mask.gained_without, "gained_with_mask": result.mask.gained},
        "calibration": {
            name: {parameter: asdict(estimate) for parameter, estimate in estimates.items()}
            for name, estimates in result.calibration.items()
        },
        "verification": verification,
        "split": {
            "held_out_captures": list(result.verification),
            "fitted_captures": len(result.observation),
            "held_out_blocks": "none: the scenes are integrated out",
            "held_out_fraction": 0.0,
            "held_out": False,
            "counted_fraction": round(float(result.corrected.log_likelihood.isfinite().double().mean()), 4),
        },
    }


def _nats_per_pixel(log_likelihood: np.ndarray) -> dict[str, Any]:
    """Return nats per pixel of all snapshots and of every one; None for a snapshot of which no block counts."""
    by_capture = [
        None if np.isnan(values).all() else float(-np.nanmean(values) / BLOCK**2) for values in log_likelihood.T
    ]
    pixels = int(np.isfinite(log_likelihood).sum()) * BLOCK**2
    return {"nll": float(-np.nanmean(log_likelihood) / BLOCK**2), "pixels": pixels, "nll_by_capture": by_capture}


def log_diagnosis(logger: Any, result: CalibratedResult | BlindDiagnosis, drawn: Mapping[str, Figure]) -> None:
    """Write the gap to a dashboard such as TensorBoard, and figures if it takes them.

    Step 0 is the ideal camera, step 1 the corrected one.

    Args:
        logger: a Lightning logger, as built from ``conf/logger``.
        result: of the diagnosis.
        drawn: figures by file name.
    """
    content = describe(result)
    for step, when in enumerate(("before", "after")):
        gap = content["gap"][when]
        kinds = {"": gap} | {f"/{kind}": misfit for kind, misfit in gap.get("by_kind", {}).items()}
        scalars = {
            f"{key}{kind}": misfit[key]
            for kind, misfit in kinds.items()
            for key in ("chi2", "rmse_dn", "nll", "prediction_error")
            if key in misfit
        }
        if isinstance(result, CalibratedResult):
            scalars["significant_tests"] = sum(test["significant"] for test in content["where"][when])
        logger.log_metrics(scalars, step)
    if hasattr(logger.experiment, "add_figure"):
        for name, figure in drawn.items():
            logger.experiment.add_figure(name.removesuffix(".png"), figure, close=False)
    logger.finalize("success")
