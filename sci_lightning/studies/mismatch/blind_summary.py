"""What blind diagnoses are worth, camera by camera: beside the decibels, which effects were named, missed and wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from sci_lightning.diagnosis.blind.undetermined import UNDETERMINED

Record = Mapping[str, Any]

SCENARIOS = ("mismatched", "known", "blind")
"""Scenarios that are compared."""
BLURS = (0.0, 0.5, 1.0, 2.0)
"""Bounds in pixels of the blur of the mask's image by which drawn cameras are grouped: a blurred mask tells less."""
HEADING = [
    "camera",
    "decoder",
    "II",
    "III",
    "IV-blind",
    "II, up to gain",
    "III, up to gain",
    "IV-blind, up to gain",
    "III less IV-blind, up to gain",
    "missed",
    "wrong",
    "processor seconds of the diagnosis",
    "commit",
]


def diagnosed_blind(records: Sequence[Record]) -> list[Record]:
    """Return the records with a blind diagnosis; those from before the score up to gain are left out."""
    return [record for record in records if all(_is_complete(record, key) for key in SCENARIOS)]


def blind_table(records: Sequence[Record]) -> list[list[str]]:
    """Return heading and rows: every camera, then the means over the drawn ones.

    Args:
        records: that :func:`diagnosed_blind` chose.
    """
    rows = [
        [record["camera"], record["decoder"], *map(_decibels, _figures(record)), *_names(record), *_origin(record)]
        for record in records
    ]
    drawn = [record for record in records if record["camera"].startswith("drawn_")]
    for decoder in dict.fromkeys(record["decoder"] for record in drawn):
        mine = [record for record in drawn if record["decoder"] == decoder]
        rows.append(_mean(f"mean of {len(mine)} drawn", mine))
        for low, high in pairwise(BLURS):
            group = [record for record in mine if low <= _blur(record) < high]
            if 0 < len(group) < len(mine):
                rows.append(_mean(f"{len(group)} of them, mask blurred by {low:g} to {high:g} pixel", group))
    return [HEADING, *rows]


def _mean(title: str, records: Sequence[Record]) -> list[str]:
    figures = [_figures(record) for record in records]
    means = [sum(column) / len(column) for column in zip(*figures, strict=True)]
    return [title, records[0]["decoder"], *map(_decibels, means), "", "", "", ""]


def _blur(record: Record) -> float:
    return float(record["mismatch"].get("mask_blur", {}).get("sigma", 0.0))


def _is_complete(record: Record, scenario: str) -> bool:
    return "psnr_up_to_gain" in record["scenarios"].get(scenario, {}).get("mean", {})


def _figures(record: Record) -> list[float]:
    scores = [record["scenarios"][key]["mean"] for key in SCENARIOS]
    plain, up_to_gain = ([one[key] for one in scores] for key in ("psnr", "psnr_up_to_gain"))
    return [*plain, *up_to_gain, up_to_gain[1] - up_to_gain[2]]


def _names(record: Record) -> list[str]:
    """Return the effects that were missed, but those that no snapshots tell, and those that were wrongly named."""
    named = [effect["name"] for effect in record["diagnosis"]["blind"]["effects"]]
    there = [name for name in record["mismatch"] if name not in UNDETERMINED]
    missed, wrong = [name for name in there if name not in named], [name for name in named if name not in there]
    return [", ".join(missed), ", ".join(wrong)]


def _origin(record: Record) -> list[str]:
    """Return how long a diagnosis took, and the commits of a record: one that a later run completed names several."""
    seconds = record["diagnosis"]["blind"].get("cpu_seconds")
    return ["" if seconds is None else f"{seconds:.0f}", str(record.get("provenance", {}).get("commit", ""))]


def _decibels(value: float) -> str:
    return f"{value:.2f}"
