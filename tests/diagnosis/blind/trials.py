"""Cases that programs here diagnose from snapshots alone: what was hidden beside what was named, a record of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from sci_lightning.files.diagnosis_report import NamedEffect, Verdict
from sci_lightning.files.json_file import says
from sci_lightning.studies.engine import CaseRecord, FailedCase, Records, digest_of, run_cases
from sci_lightning.studies.proving_ground.outcome import names_meant
from tests.measurements_file import Column, in_words

COLUMNS: list[Column] = [
    ("hidden", "hidden", None),
    ("right", "named, and nothing else", None),
    ("wrong", "a wrong name, `explained`", None),
    ("held", "95 % intervals that hold", None),
    ("instead", "named otherwise", None),
    ("clear", "missed, yet clear to a search that begins with the truth", None),
    ("seconds", "processor seconds", 0),
]
"""Of a table of what :func:`row` returns."""


@dataclass(frozen=True)
class Trial:
    """A case: what is hidden, its number among all, and the side of a snapshot in pixels."""

    hidden: str
    number: int
    side: int

    @property
    def name(self) -> str:
        return f"{self.hidden.replace(' ', '')}-{self.number}-{self.side}"

    @property
    def digest(self) -> str:
        return digest_of(asdict(self))

    def describe(self) -> dict[str, Any]:
        return {"format": "sci-blind-case", "format_version": 1, "digest": self.digest, **asdict(self)}


class TrialRecord(CaseRecord):
    """What was hidden in a case, and what the diagnosis said."""

    format: Literal["sci-blind-case"]
    format_version: Literal[1]
    hidden: str
    number: int
    side: int
    truth: dict[str, dict[str, Any]] = says("parameters of what is hidden, by the names of effects")
    verdict: Verdict
    named: list[NamedEffect]
    cpu_seconds: float
    clear_by_truth: list[str] = says("missed, yet clear to a search that begins with the truth", default=[])

    @property
    def missed(self) -> list[str]:
        """Hidden effects that no named class contains."""
        return [name for name in self.truth if not any(name in names_meant(effect) for effect in self.named)]

    @property
    def wrong(self) -> list[str]:
        """Names of whose class no member is hidden."""
        return [effect.name for effect in self.named if names_meant(effect).isdisjoint(self.truth)]

    @property
    def right(self) -> bool:
        """Whether everything that is hidden was named, or one that the snapshots cannot tell from it, and no more."""
        return not self.missed and not self.wrong

    @property
    def names(self) -> str:
        """What was named, in words."""
        return ", ".join(sorted(effect.name for effect in self.named)) or "nothing"

    @property
    def held(self) -> list[bool]:
        """Of every number of effects that were rightly named whether its 95 % interval holds the truth."""
        return [
            abs(float(one.value) - float(self.truth[effect.name][key])) < 1.96 * one.std
            for effect in self.named
            if effect.name in self.truth
            for key, one in effect.parameters.items()
            if one.std and key in self.truth[effect.name]
        ]


def diagnosed(captures: Captures, truth: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Diagnose snapshots, and return what a record says of it."""
    begun = time.process_time()
    diagnosis = diagnose_blind(captures)
    named = [effect.describe() for effect in diagnosis.effects]
    seconds = time.process_time() - begun
    return {"truth": truth, "verdict": diagnosis.verdict, "named": named, "cpu_seconds": seconds}


def ran(work: Callable[[Trial], dict[str, Any]], trials: Sequence[Trial], out: Path) -> list[TrialRecord]:
    """Run the cases that have no record in a folder yet, one after the other, and return the records of all.

    Args:
        work: computes a case.
        trials: in the order in which they are begun.
        out: folder of the records.
    """
    records = Records(out, TrialRecord)
    for ended in run_cases(work, records.missing(trials), records):
        if isinstance(ended, FailedCase):
            print(ended, flush=True)
        else:
            said = f"{ended.names}, {ended.verdict}, {ended.cpu_seconds:.0f} s"
            print(f"{ended.number} {ended.hidden}: {said}", flush=True)
    return records.all_of(trials, print)


def row(title: str, cases: Sequence[TrialRecord]) -> dict[str, Any]:
    """Return a row of a table: how often what is hidden was named and nothing else, and what was named instead."""
    held = [each for one in cases for each in one.held]
    missed = sum(len(one.missed) for one in cases)
    return {
        "hidden": title,
        "right": in_words(one.right for one in cases),
        "wrong": in_words(bool(one.wrong) and one.verdict == "explained" for one in cases),
        "held": f"{sum(held)} of {len(held)}" if held else "",
        "instead": "; ".join(sorted({one.names for one in cases if not one.right})),
        "clear": f"{sum(len(one.clear_by_truth) for one in cases)} of {missed}" if missed else "",
        "seconds": float(np.median([one.cpu_seconds for one in cases])),
    }


def rows(cases: Sequence[TrialRecord]) -> list[dict[str, Any]]:
    """Return a row for everything that was hidden, in the order of the cases."""
    hidden = dict.fromkeys(one.hidden for one in cases)
    return [row(name, [one for one in cases if one.hidden == name]) for name in hidden]
