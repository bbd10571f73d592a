"""What blind diagnoses are worth, by groups of cameras: beside the decibels, which effects were missed and wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sci_lightning.diagnosis.blind.undetermined import UNDETERMINED

Record = Mapping[str, Any]

SCENARIOS = ("mismatched", "known", "blind")
"""Scenarios that are compared."""
HEADING = [
    "PSNR up to gain (dB)",
    "II",
    "III",
    "IV-blind",
    "III less IV-blind",
    "largest",
    "missed",
    "wrong",
    "processor seconds of a diagnosis",
]


def diagnosed_blind(records: Sequence[Record]) -> list[Record]:
    """Return the records with a blind diagnosis; those from before the score up to gain are left out."""
    return [record for record in records if all(_is_complete(record, key) for key in SCENARIOS)]


def blind_table(records: Sequence[Record]) -> list[list[str]]:
    """Return heading and rows: the published camera, then the mean over the drawn ones.

    Args:
        records: that :func:`diagnosed_blind` chose, of one decoder.
    """
    drawn = [record for record in records if record["camera"].startswith("drawn_")]
    published = [record for record in records if record["camera"] == "published"]
    groups = {"published": published, f"mean of {len(drawn)} drawn": drawn}
    return [HEADING, *(_row(title, group) for title, group in groups.items() if group)]


def _row(title: str, records: Sequence[Record]) -> list[str]:
    scores = [[record["scenarios"][key]["mean"]["psnr_up_to_gain"] for key in SCENARIOS] for record in records]
    means = [sum(column) / len(column) for column in zip(*scores, strict=True)]
    lost = [known - blind for _, known, blind in scores]
    missed: list[str] = []
    wrong: list[str] = []
    for record in records:
        named = [effect["name"] for effect in record["diagnosis"]["blind"]["effects"]]
        there = [name for name in record["mismatch"] if name not in UNDETERMINED]  # which no snapshots tell
        missed += [name for name in there if name not in named]
        wrong += [name for name in named if name not in there]
    seconds = sorted(round(record["diagnosis"]["blind"]["cpu_seconds"]) for record in records)
    figures = [f"{value:.2f}" for value in (*means, sum(lost) / len(lost), max(lost))]
    times = " to ".join(str(value) for value in dict.fromkeys((seconds[0], seconds[-1])))
    return [title, *figures, _counted(missed), _counted(wrong), times]


def _counted(names: Iterable[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in Counter(names).most_common())


def _is_complete(record: Record, scenario: str) -> bool:
    return "psnr_up_to_gain" in record["scenarios"].get(scenario, {}).get("mean", {})
