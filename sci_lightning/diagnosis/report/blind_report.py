"""The files of a blind diagnosis: ``report.json``, ``report.html``, pictures, ``encoder.yaml`` and effective masks.

Everything here reads a :class:`~sci_lightning.diagnosis.blind.blind_diagnosis.BlindDiagnosis`; only the reconstruction
that is shown is computed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sci_lightning.console import PlainConsole, styled
from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.blind.held_out.paired_comparison import PairedComparison
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.blind.undetermined import SHOWN_IF_STRONG
from sci_lightning.diagnosis.model.camera_model import NOISE_GUESS
from sci_lightning.diagnosis.report.corrected_camera import (
    prediction_figure,
    reconstruction_figure,
    write_effective_mask,
)
from sci_lightning.diagnosis.report.digits import quantity, uncertainty
from sci_lightning.diagnosis.report.report import VERIFIED_BY_NONE, write_corrected_encoder
from sci_lightning.diagnosis.report.report_page import Provenance, environment, without_empty_columns
from sci_lightning.diagnosis.report.sentences import class_paths, clause, considered
from sci_lightning.diagnosis.report.svg import AFTER, FAINT, style
from sci_lightning.diagnosis.report.terminal import COLOURS
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.version import installed_version

COLUMNS = ("effect", "stage", "parameter", "value", "error (1 σ)", "unit", "snapshots that ask for it", "alternatives")
"""Titles of the table of what was found; what stands in none of its rows is left out."""
BLIND_UNCERTAINTY = (
    "Uncertainties are one standard deviation, from the differences between blocks and between snapshots, because the "
    "statistics of the scenes are only roughly right. What is the same for all scenes, such as an error of the "
    "patterns, comes on top."
)
"""What ``std`` of the report means, for people."""


def write_blind_report(diagnosis: BlindDiagnosis, out: str | Path, provenance: Provenance | None = None) -> None:
    """Write all files of a blind diagnosis into the folder ``out``; none is ever half written.

    Pictures of an earlier diagnosis in the same folder that this one does not draw are removed.

    Args:
        diagnosis: the result.
        out: the folder; created if it does not exist.
        provenance: what was diagnosed, when and how; None if the report is to say nothing about that.
    """
    out, provenance = Path(out), provenance or Provenance()
    content = describe_blind(diagnosis)
    with atomic_write(out / "report.json") as temporary:
        temporary.write_text(json.dumps(content | provenance.describe(), indent=1) + "\n")
    effects = {
        name: values
        for name, values in diagnosis.corrected.hypothesis.effects.items()
        if name not in NOISE_GUESS or name in diagnosis.stated_noise
    }
    write_corrected_encoder(diagnosis.observation, diagnosis.model, effects, {}, out)
    drawn = {}
    if (evidence := snapshots_figure(diagnosis)) is not None:
        drawn["evidence.png"] = evidence
    camera = diagnosis.camera
    if diagnosis.effects and diagnosis.prediction is not None and camera is not None:
        before, after = (
            camera.encoder_of(diagnosis.model.path(fit.hypothesis)) for fit in (diagnosis.ideal, diagnosis.corrected)
        )
        write_effective_mask(after, out)
        snapshot = camera.measurement[int(np.argmax(camera.verification.numpy()))]
        drawn["prediction.png"] = prediction_figure(diagnosis.prediction.gap, camera.numbers, diagnosis.verification)
        drawn["reconstruction.png"] = reconstruction_figure(snapshot, before, after)
    for name in CAPTIONS.keys() - drawn.keys():
        (out / name).unlink(missing_ok=True)
    for name, figure in drawn.items():
        with atomic_write(out / name) as temporary:
            figure.savefig(temporary, dpi=150, facecolor="white", bbox_inches="tight")
    page = _page(diagnosis, drawn, provenance)
    with atomic_write(out / "report.html") as temporary:
        temporary.write_text(page, encoding="utf-8")


CAPTIONS = {
    "evidence.png": (
        "What every snapshot gains by the corrected camera, and what candidates gained in the first round of the "
        "search, beside what it began with."
    ),
    "prediction.png": "The error of held-out pixels by the ideal camera and by the corrected one.",
    "reconstruction.png": "A part of a snapshot, reconstructed for the ideal camera and for the corrected one.",
}
"""What the pictures show, by the names of their files."""


def _page(diagnosis: BlindDiagnosis, drawn: Mapping[str, Figure], provenance: Provenance) -> str:
    """Return ``report.html``, which needs no other file."""
    observation, judged = diagnosis.observation, diagnosis.prediction
    height, width = observation.size
    page = {
        "verdict": diagnosis.verdict,
        "names": diagnosis.names,
        "headline": blind_headline(diagnosis),
        "about": f"{_snapshots(len(observation))}, {height} x {width} pixels, {observation.frames} slots, "
        f"{observation.bit_depth} bits",
        "notes": _further_notes(diagnosis),
        "uncertainty": BLIND_UNCERTAINTY,
        "predicted": [] if judged is None else predicted_errors(judged.gap, judged.without_mask, judged.verification),
        "figures": {CAPTIONS[name]: figure for name, figure in drawn.items()},
        "advice": diagnosis.next_captures,
        "undetermined": diagnosis.undetermined,
        "remark": "A displacement of mask and scene together, scenes that are less sharp, and patterns in reversed "
        "order (scenes that run backwards) cannot be told either. "
        f"Nobody has looked for deviations without a name; {considered(diagnosis.considered)}.",
    }
    table = without_empty_columns(COLUMNS, _rows(diagnosis))
    template = environment().get_template("blind_page.html")
    return template.render(page=page, table=table, provenance=provenance, version=installed_version())


def predicted_errors(
    gap: PairedComparison, without_mask: PairedComparison, verification: PairedComparison | None
) -> list[tuple[str, float]]:
    """Return the prediction errors of three cameras on all snapshots, and of two on those that were set aside.

    Args:
        gap: the ideal camera against the corrected one.
        without_mask: a camera whose mask is the same everywhere against the corrected one.
        verification: ``gap`` on the snapshots that were set aside.
    """
    rows = [("the ideal camera", gap.before), ("the corrected camera", gap.after)]
    rows.append(("a camera without any mask", without_mask.before))
    if verification is not None:
        rows.append(("snapshots set aside, the ideal camera", verification.before))
        rows.append(("snapshots set aside, the corrected camera", verification.after))
    return rows


def describe_blind(diagnosis: BlindDiagnosis) -> dict[str, Any]:
    """Return the content of ``report.json`` without its provenance, as plain data; the schema describes every field."""
    noise = {name: values for name, values in diagnosis.corrected.hypothesis.effects.items() if name in NOISE_GUESS}
    judged = diagnosis.prediction
    predicted: dict[str, dict[str, Any]] = {"before": {}, "after": {}} if judged is None else judged.gap.sides()
    counted = float(diagnosis.corrected.log_likelihood.isfinite().double().mean())
    return {
        "format": "sci-diagnosis",
        "format_version": 2,
        "verdict": diagnosis.verdict,
        "effects": [effect.describe() for effect in diagnosis.effects],
        "uncertainty": BLIND_UNCERTAINTY,
        "gap": {
            "before": _gap(diagnosis.ideal.log_likelihood.numpy()) | predicted["before"],
            "after": _gap(diagnosis.corrected.log_likelihood.numpy()) | predicted["after"],
        },
        "unnamed": [],
        "where": {"before": [], "after": []},
        "noise": {**noise, "stated_by_the_file": list(diagnosis.stated_noise)},
        "considered": class_paths(diagnosis.considered),
        "next_captures": list(diagnosis.next_captures),
        "mode": "blind",
        "laboratory": [],
        "undetermined": [{"effect": name, "looks_like": why} for name, why in diagnosis.undetermined.items()],
        "notes": list(diagnosis.notes),
        "verification": _verification(diagnosis),
        "split": {
            "held_out_captures": list(diagnosis.verification),
            "fitted_captures": len(diagnosis.observation),
            "held_out_blocks": "none: the scenes are integrated out",
            "held_out_fraction": 0.0,
            "held_out": False,
            "counted_fraction": round(counted, 4),
        },
        "seed": diagnosis.seed,
        "sci_lightning": installed_version(),
    }


def _verification(diagnosis: BlindDiagnosis) -> dict[str, Any]:
    """Return the prediction errors of the snapshots that were set aside, of the corrected and of the ideal camera."""
    verified = None if diagnosis.prediction is None else diagnosis.prediction.verification
    if verified is None:
        return VERIFIED_BY_NONE
    sides = verified.sides()
    return {"captures": list(diagnosis.verification), **sides["after"], "before": sides["before"]}


def _gap(log_likelihood: np.ndarray) -> dict[str, Any]:
    """Return nats per pixel of all snapshots and of every one; None for a snapshot of which no block counts."""
    by_capture = [
        None if np.isnan(values).all() else float(-np.nanmean(values) / BLOCK**2) for values in log_likelihood.T
    ]
    pixels = int(np.isfinite(log_likelihood).sum()) * BLOCK**2
    return {"nll": float(-np.nanmean(log_likelihood) / BLOCK**2), "pixels": pixels, "nll_by_capture": by_capture}


def blind_headline(diagnosis: BlindDiagnosis) -> str:
    """Return the result in one sentence."""
    if diagnosis.verdict == "unexplained":
        return diagnosis.notes[0]
    count = len(diagnosis.observation)
    snapshots = "The snapshot agrees" if count == 1 else f"The {count} snapshots agree"
    if not diagnosis.effects:
        return f"{snapshots} with the ideal camera, as far as unknown scenes can tell."
    clauses = []
    for effect in diagnosis.effects:
        either = f" (or it is {' or '.join(effect.alternatives)}, which these snapshots cannot tell from it)"
        clauses.append(clause(effect) + (either if effect.alternatives else ""))
    named = " and ".join(filter(None, (", ".join(clauses[:-1]), clauses[-1])))
    return f"{named[0].upper()}{named[1:]}: that makes snapshots of unknown scenes most likely."


def _further_notes(diagnosis: BlindDiagnosis) -> tuple[str, ...]:
    """Return the notes beside the headline, which is the first of them where the verdict is ``unexplained``."""
    return diagnosis.notes[1:] if diagnosis.verdict == "unexplained" else diagnosis.notes


def print_blind_report(diagnosis: BlindDiagnosis, console: PlainConsole) -> None:
    """Print the verdict, the named effects with what speaks for them, and what the snapshots leave undetermined."""
    verdict = styled(diagnosis.verdict, f"bold {COLOURS[diagnosis.verdict]}")
    console.say(verdict, f" (scenes unknown): {blind_headline(diagnosis)}")
    for effect in diagnosis.effects:
        console.say(
            f"{effect.name}: {effect.agree} of {_snapshots(effect.snapshots)} ask for it, "
            f"{effect.delta_nll or 0:,.0f} calibrated nats, p = {effect.p_value:.2g}"
        )
    if diagnosis.prediction is not None and diagnosis.effects:
        gap = diagnosis.prediction.gap
        console.say(
            f"held-out pixels: prediction error {gap.before:.3g} before, {gap.after:.3g} after; {gap.agree} of "
            f"{_snapshots(gap.snapshots)} ask for it, p = {gap.p_value:.2g}"
        )
    for note in _further_notes(diagnosis):
        console.say(note)
    hidden = [f"a weak {name}" if name in SHOWN_IF_STRONG else name for name in diagnosis.undetermined]
    console.say(f"unknown scenes cannot tell: {', '.join(hidden)}; report.json says why")
    console.say(considered(diagnosis.considered))
    for advice in diagnosis.next_captures:
        console.say(styled("record next"), f": {advice}")


def _snapshots(count: int) -> str:
    return f"{count} snapshot{'s' * (count != 1)}"


def snapshots_figure(diagnosis: BlindDiagnosis) -> Figure | None:
    """Draw how many nats per pixel every snapshot gains by the corrected camera, and what the candidates would gain.

    Returns:
        None where nothing was named and no candidate was fitted, so that there is nothing to draw.
    """
    first = sorted(diagnosis.rounds[0].items(), key=lambda entry: entry[1]) if diagnosis.rounds else []
    count = bool(diagnosis.effects) + bool(first)
    if not count:
        return None
    with style():
        figure = Figure(figsize=(3.3 * max(count, 1.5), 3.0), layout="constrained")
        panels = list(figure.subplots(1, count, squeeze=False)[0])
        if diagnosis.effects:
            axes = panels.pop(0)
            gained = (diagnosis.corrected.log_likelihood - diagnosis.ideal.log_likelihood).nanmean(0) / BLOCK**2
            axes.bar(range(len(gained)), gained.nan_to_num(0.0).numpy(), color=AFTER)
            axes.set_xticks(range(len(gained)), [str(number) for number in diagnosis.observation.number.tolist()])
            axes.set(xlabel="snapshot", ylabel="nats per pixel gained", title="by snapshot")
        if first:
            axes = panels.pop(0)
            colours = [AFTER if name in diagnosis.names else FAINT for name, _ in first]
            axes.barh([name for name, _ in first], [max(nats, 0.0) for _, nats in first], color=colours)
            axes.set(xlabel="calibrated nats", title="candidates of the first round")
    return figure


def _rows(diagnosis: BlindDiagnosis) -> list[tuple[str, ...]]:
    """Return effect, stage, parameter, value, error, unit and evidence of every parameter."""
    rows: list[tuple[str, ...]] = []
    for effect in diagnosis.effects:
        for name, estimate in effect.parameters.items():
            value = quantity(estimate.value, estimate.std, estimate.systematic).split(" ")[0]
            error = uncertainty(estimate.std)
            rows.append(
                (
                    effect.name,
                    effect.effect.stage,
                    name,
                    value,
                    error and f"\u00b1 {error}",
                    "" if estimate.unit == "1" else estimate.unit,
                    f"{effect.agree} of {effect.snapshots}",
                    ", ".join(effect.alternatives),
                )
            )
    return rows
