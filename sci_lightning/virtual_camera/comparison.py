"""The report of a diagnosis, of any origin, compared with what was hidden."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.diagnosis_report import BlindGap, DiagnosisReport, Estimate, NamedEffect
from sci_lightning.files.json_file import read_json
from sci_lightning.virtual_camera.hardware.effect import Value
from sci_lightning.virtual_camera.truth import HiddenEffect


@dataclass(frozen=True)
class Report:
    """What is compared of the report of a diagnosis.

    Attributes:
        effects: the effects that it names.
        unnamed_stages: stages at which something remains that no effect explains.
        chi2_before, chi2_after: reduced chi-square of held-out pixels without and with these effects.
    """

    effects: tuple[NamedEffect, ...]
    unnamed_stages: tuple[str, ...]
    chi2_before: float
    chi2_after: float


@dataclass(frozen=True)
class ComparedParameter:
    """One parameter, true and estimated.

    Attributes:
        effect, parameter, unit: which parameter.
        truth: its true value, None where the effect was not hidden.
        estimate: what the diagnosis reports, None where it does not report the effect.
        answer: ``within 95 %``, ``outside 95 %``, ``right``, ``wrong``, ``not found``, ``not hidden``
            or ``true as well``.
    """

    effect: str
    parameter: str
    unit: str
    truth: Value | None
    estimate: Estimate | None
    answer: str


def compare(hidden: Sequence[HiddenEffect], report: Report, also_true: Sequence[str] = ()) -> list[ComparedParameter]:
    """Compare every parameter of the hidden effects, then list those of effects that were reported but not hidden.

    Args:
        hidden: the hidden effects.
        report: what the diagnosis says.
        also_true: names that are right though nothing of the kind was hidden.
    """
    reported = {effect.name: effect.parameters for effect in report.effects}
    rows = []
    for effect in hidden:
        for name, true_value in effect.parameters.items():
            unit, estimate = effect.units[name], reported.get(effect.name, {}).get(name)
            answer = _answer(true_value, unit, estimate)
            rows.append(ComparedParameter(effect.name, name, unit, true_value, estimate, answer))
    hidden_names = {effect.name for effect in hidden}
    for named in report.effects:
        if named.name not in hidden_names:
            answer = "true as well" if named.name in also_true else "not hidden"
            rows += [
                ComparedParameter(named.name, name, estimate.unit, None, estimate, answer)
                for name, estimate in named.parameters.items()
            ]
    return rows


def verdict(hidden: Sequence[HiddenEffect], report: Report, also_true: Sequence[str] = ()) -> str:
    """Say in one sentence how the reported names compare with the hidden ones; arguments as of :func:`compare`."""
    stages = {effect.name: effect.stage for effect in hidden}
    reported = [effect.name for effect in report.effects if effect.name in stages or effect.name not in also_true]
    if not hidden:
        anything = reported or report.unnamed_stages
        return f"nothing was hidden{': a false alarm' if anything else ', and nothing was named'}"
    if set(reported) == set(stages):
        return f"every name is right{', but something is left unnamed' if report.unnamed_stages else ''}"
    outside = [effect.name for effect in hidden if not effect.in_vocabulary]
    if outside and not reported and set(report.unnamed_stages) & {stages[name] for name in outside}:
        return f"{', '.join(outside)} has no name in the vocabulary; the stage is right"
    missed = [name for name in stages if name not in reported]
    wrong = [name for name in reported if name not in stages]
    alternatives = {name for effect in report.effects for name in effect.alternatives}
    parts = {
        "missed": missed,
        "not hidden": wrong,
        "among the alternatives": [name for name in missed if name in alternatives],
    }
    return "; ".join(f"{part}: {', '.join(names)}" for part, names in parts.items() if names)


def _answer(truth: Value, unit: str, estimate: Estimate | None) -> str:
    """Judge an estimate; angles in radians are compared modulo a full turn."""
    if estimate is None:
        return "not found"
    if isinstance(truth, float) and not isinstance(estimate.value, str):
        error = float(estimate.value) - truth
        error = math.remainder(error, 2 * math.pi) if unit == "rad" else error
        return "within 95 %" if abs(error) <= 1.96 * estimate.std else "outside 95 %"
    return "right" if estimate.value == truth else "wrong"


def read_report(path: str | Path) -> Report:
    """Read the ``report.json`` of a diagnosis.

    Raises:
        BadInput: no such file, something else than a report, or one of a blind diagnosis, which has no chi2.
    """
    report = read_json(path, DiagnosisReport)
    before, after = report.gap.before, report.gap.after
    if isinstance(before, BlindGap) or isinstance(after, BlindGap):
        raise BadInput(f"{path}: of a blind diagnosis, expected one of calibration captures, with gap.before.chi2")
    effects = (*report.laboratory, *report.effects)
    return Report(effects, tuple(part.stage for part in report.unnamed), before.chi2, after.chi2)
