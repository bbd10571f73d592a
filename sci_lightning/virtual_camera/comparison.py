"""A diagnosis beside the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sci_lightning.virtual_camera.hardware.parameter import Value


@dataclass(frozen=True)
class Compared:
    """One parameter, as hidden and as found.

    Attributes:
        effect, parameter, unit: which one.
        truth: None where the effect was not hidden.
        found: None where it was not found.
        std: of ``found``; 0 for a choice or a whole number.
        answer: ``within 95 %``, ``outside 95 %``, ``right``, ``wrong``, ``not found`` or ``not hidden``.
    """

    effect: str
    parameter: str
    unit: str
    truth: Value | None
    found: Value | None
    std: float
    answer: str


def compare(truth: Mapping[str, Any], report: Mapping[str, Any]) -> list[Compared]:
    """Every parameter of what is hidden, then of what is found besides.

    Args:
        truth: ``<captures>.truth.json``. report: ``report.json`` of a diagnosis.
    """
    found = {each["name"]: each["parameters"] for each in report["effects"]}
    hidden = {each["name"]: each for each in truth["effects"]}
    rows = [
        _judge(name, parameter, effect["units"][parameter], value, found.get(name, {}).get(parameter))
        for name, effect in hidden.items()
        for parameter, value in effect["parameters"].items()
    ]
    rows += [
        Compared(name, parameter, about["unit"], None, about["value"], float(about["std"]), "not hidden")
        for name, parameters in found.items()
        if name not in hidden
        for parameter, about in parameters.items()
    ]
    return rows


def verdict(truth: Mapping[str, Any], report: Mapping[str, Any]) -> str:
    """One sentence: how the names found compare with those hidden."""
    hidden = {each["name"]: each["stage"] for each in truth["effects"]}
    found = [each["name"] for each in report["effects"]]
    unnamed = [each["stage"] for each in report["unnamed"]]
    if not hidden:
        return (
            "nothing was hidden, and nothing was found" if not found + unnamed else "nothing was hidden: a false alarm"
        )
    if set(found) == set(hidden):
        return "every name is right" + (", but something is left unnamed" if unnamed else "")
    outside = [each["name"] for each in truth["effects"] if not each["in_vocabulary"]]
    if outside and not found and set(unnamed) & {hidden[name] for name in outside}:
        return f"{', '.join(outside)} has no name in the vocabulary; the stage is right"
    maybe = {other for each in report["effects"] for other in each["alternatives"]}
    missed = [name for name in hidden if name not in found]
    wrong = [name for name in found if name not in hidden]
    parts = [f"missed: {', '.join(missed)}" if missed else "", f"not hidden: {', '.join(wrong)}" if wrong else ""]
    if named := [name for name in missed if name in maybe]:
        parts.append(f"among the alternatives: {', '.join(named)}")
    return "; ".join(part for part in parts if part)


def _judge(effect: str, parameter: str, unit: str, truth: Value, found: Mapping[str, Any] | None) -> Compared:
    if found is None:
        return Compared(effect, parameter, unit, truth, None, 0.0, "not found")
    value, std = found["value"], float(found["std"])
    if isinstance(truth, float) and not isinstance(value, str):
        error = float(value) - truth
        error = math.remainder(error, 2 * math.pi) if unit == "rad" else error
        answer = "within 95 %" if abs(error) <= 1.96 * std else "outside 95 %"
    else:
        answer = "right" if value == truth else "wrong"
    return Compared(effect, parameter, unit, truth, value, std, answer)
