"""Diagnose a round of the textbook camera: ``python -m tests.textbook_camera.score OUT ROUND [FIRST LAST STEP]``.

Every case leaves a record in ``OUT/cases``; the same line goes on where it ended. Round 0 is for development; any other
one is sealed, and is run once. When all cases have a record, ``docs/results/textbook-ROUND.json`` holds the counts.
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.files.diagnosis_report import NamedEffect, Unnamed, Verdict
from sci_lightning.files.json_file import says
from sci_lightning.studies.engine.records import CaseRecord, FailedCase, Records, digest_of
from sci_lightning.studies.engine.run_cases import run_cases
from sci_lightning.studies.proving_ground.outcome import names_meant
from sci_lightning.studies.proving_ground.reliability import Statement, statements
from tests.measurements_file import MeasurementsFile, in_words
from tests.textbook_camera.recording import save
from tests.textbook_camera.suite import GROUPS, cases, record, seed_of

SIZE = 64
QUANTILES = {"50 %": 0.674490, "80 %": 1.281552, "95 %": 1.959964}
"""Half the widths of intervals of a normal distribution, in standard deviations."""
PROBABILITIES = (0.5, 0.8, 0.95, 0.999, 1.01)
"""Between which the stated probabilities of names are counted together."""
COLUMNS: list[tuple[str, str, int | None]] = [
    ("world", "world", None),
    ("hidden", "hidden", None),
    ("exact", "exactly what is hidden is named, or its class", None),
    ("wrong", "with a wrong name", None),
    ("missed", "hidden names missed", None),
    ("stage", "stage of what has no name right", None),
    ("agrees", "`consistent` or `explained`", None),
    ("median", "processor seconds, median", 0),
    ("longest", "longest", 0),
]
TRUST: list[tuple[str, str, int | None]] = [
    ("world", "world", None),
    ("stated", "stated", None),
    ("right", "right", None),
]


@dataclass(frozen=True)
class Trial:
    """A case of a round."""

    round: int
    number: int

    @property
    def name(self) -> str:
        return f"round{self.round}-case{self.number:02d}"

    @property
    def digest(self) -> str:
        return digest_of({"round": self.round, "number": self.number, "size": SIZE})

    def describe(self) -> dict[str, Any]:
        about = {"format": "sci-textbook-case", "format_version": 1, "digest": self.digest}
        return about | {"round": self.round, "number": self.number}


class TrialRecord(CaseRecord):
    """What was hidden in a case, and what the diagnosis said."""

    format: Literal["sci-textbook-case"]
    format_version: Literal[1]
    round: int
    number: int
    truth: dict[str, Any] = says("as the textbook camera states it")
    verdict: Verdict
    named: list[NamedEffect]
    unnamed: list[Unnamed]
    not_named: dict[str, float] = says("how probable other effects are", default={})
    not_tried: list[str]
    cpu_seconds: float

    @property
    def hidden(self) -> list[dict[str, Any]]:
        return list(self.truth["hidden"])

    def meant(self, hidden: Mapping[str, Any]) -> NamedEffect | None:
        """Return the named effect that is a hidden one, or one that it cannot be told from."""
        right = set(hidden["accepted"] or ())
        return next((effect for effect in self.named if right & names_meant(effect)), None)

    @property
    def statements(self) -> list[Statement]:
        """What the diagnosis states with a probability, and whether it is true."""
        true = {name for one in self.hidden for name in (*(one["accepted"] or ()), *one["tolerated"])}
        return statements(self.named, self.not_named, true)

    @property
    def missed(self) -> list[str]:
        """Hidden effects with a name that the diagnosis did not name."""
        return [one["deviation"] for one in self.hidden if one["accepted"] and self.meant(one) is None]

    def is_wrong(self, effect: NamedEffect) -> bool:
        """Whether no member of a name's class is true or tolerated."""
        right = {name for one in self.hidden for name in (*(one["accepted"] or ()), *one["tolerated"])}
        return right.isdisjoint(names_meant(effect))

    @property
    def stage_is_right(self) -> bool:
        """Whether the strongest deviation without a name is at a stage of what is hidden."""
        stages = {stage for one in self.hidden for stage in one["stages"]}
        return bool(self.unnamed) and max(self.unnamed, key=lambda one: one.nats).stage in stages

    @property
    def errors(self) -> list[tuple[str, float]]:
        """``effect.parameter`` and how many standard deviations its estimate is off, beyond the truth's tolerance."""
        off = []
        for one in self.hidden:
            effect = self.meant(one)
            for name, true in one["parameters"].items():
                estimate = None if effect is None else effect.parameters.get(name)
                if effect is None or estimate is None or not estimate.std or effect.name != one["deviation"]:
                    continue
                value = float(estimate.value)
                error = abs(value) - abs(true) if name in one["unsigned"] else value - true
                beyond = math.copysign(max(abs(error) - one["tolerance"].get(name, 0.0), 0.0), error)
                off.append((f"{effect.name}.{name}", beyond / estimate.std))
        return off


def work(trial: Trial) -> dict[str, Any]:
    """Record a case, diagnose the file, and return both."""
    case = cases(trial.round)[trial.number - 1]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "captures.h5"
        contents, truth = record(case, seed_of(trial.round, trial.number), SIZE)
        save(path, contents, truth)
        captures = read_captures(path)
    begun = time.process_time()
    report = describe(diagnose(captures))
    return {
        "truth": truth,
        "verdict": report["verdict"],
        "named": report["laboratory"] + report["effects"],
        "unnamed": report["unnamed"],
        "not_named": report["not_named"],
        "not_tried": report["budget"]["not_tried"],
        "cpu_seconds": time.process_time() - begun,
    }


def row(world: str, group: str, records: Sequence[TrialRecord]) -> dict[str, Any]:
    """Return what was right and wrong in the cases of one world and one group."""
    wrong = [any(map(one.is_wrong, one.named)) for one in records]
    hidden = sum(bool(one["accepted"]) for record in records for one in record.hidden)
    unnamed = [one for one in records if one.truth["group"] == "outside"]
    return {
        "world": world,
        "hidden": group,
        "exact": in_words(not one.missed and not bad for one, bad in zip(records, wrong, strict=True)),
        "wrong": in_words(wrong),
        "missed": f"{sum(len(one.missed) for one in records)} of {hidden}" if hidden else "",
        "stage": f"{sum(one.stage_is_right for one in unnamed)} of {len(unnamed)}" if unnamed else "",
        "agrees": f"{sum(one.verdict in ('consistent', 'explained') for one in records)} of {len(records)}",
        "median": float(np.median([one.cpu_seconds for one in records])),
        "longest": max(one.cpu_seconds for one in records),
    }


def rows(records: Sequence[TrialRecord]) -> list[dict[str, Any]]:
    """Return the rows of the table of a round."""
    chosen = {
        (world, group): [one for one in records if (one.truth["world"], one.truth["group"]) == (world, group)]
        for world in ("clean", "laboratory")
        for group in GROUPS
    }
    return [row(*key, some) for key, some in chosen.items() if some]


def trust(records: Sequence[TrialRecord]) -> list[dict[str, Any]]:
    """Return, for every world, how many intervals hold and how many names of every stated probability are right."""
    table = []
    for world in ("clean", "laboratory"):
        some = [one for one in records if one.truth["world"] == world]
        errors = [abs(error) for one in some for _, error in one.errors]
        for label, width in QUANTILES.items():
            table.append(
                {"world": world, "stated": f"interval of {label}", "right": in_words(e <= width for e in errors)}
            )
        stated = [(effect.probability, not one.is_wrong(effect)) for one in some for effect in one.named]
        for low, high in itertools.pairwise(PROBABILITIES):
            right = [good for probability, good in stated if probability is not None and low <= probability < high]
            if right:
                label = f"probability of a name {low:g} to {min(high, 1.0):g}"
                table.append({"world": world, "stated": label, "right": in_words(right)})
    return table


def main(out: Path, round_: int, first: int = 1, last: int = 64, step: int = 1) -> None:
    records = Records(out / "cases", TrialRecord)
    for ended in run_cases(
        work, [Trial(round_, number) for number in range(first, last + 1, step)], records, workers=1
    ):
        if isinstance(ended, FailedCase):
            print(ended, flush=True)
            continue
        wrong = [effect.name for effect in ended.named if ended.is_wrong(effect)]
        hidden = " + ".join(one["deviation"] for one in ended.hidden) or "nothing"
        off = ", ".join(f"{name} {error:+.1f}" for name, error in ended.errors)
        print(
            f"{ended.number} {ended.truth['world']}: {hidden}; {ended.verdict}; missed {ended.missed}, wrong {wrong}, "
            f"unnamed {[one.stage for one in ended.unnamed]}; {off}; {ended.cpu_seconds:.0f} s",
            flush=True,
        )
    ended_cases = [one for one in map(records.ended, every_case(round_)) if isinstance(one, TrialRecord)]
    if len(ended_cases) < len(every_case(round_)):
        print(f"{len(ended_cases)} of {len(every_case(round_))} cases have a record; the tables need all of them")
        return
    about = {
        "machine": "one thread",
        "scale": f"{len(ended_cases)} cameras, 34 captures of {SIZE} x {SIZE} pixels, eight slots",
        "seeds": f"round {round_}",
        "command": f"python -m tests.textbook_camera.score OUT {round_}",
    }
    MeasurementsFile(Path(f"docs/results/textbook-{round_}.json"), **about).write(COLUMNS, rows(ended_cases))
    MeasurementsFile(Path(f"docs/results/textbook-{round_}-trust.json"), **about).write(TRUST, trust(ended_cases))


def every_case(round_: int) -> list[Trial]:
    """Return all cases of a round."""
    return [Trial(round_, number) for number in range(1, len(cases(round_)) + 1)]


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
