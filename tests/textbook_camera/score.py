"""Diagnose a round of the textbook camera: ``python -m tests.textbook_camera.score OUT ROUND [FIRST LAST STEP]``.

Every case leaves a record in ``OUT/cases``; the same line goes on where it ended. Round 0 is for development; any other
one is sealed, and is run once. ``python -m tests.textbook_camera.tables`` writes the tables of a round.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.files.diagnosis_report import NamedEffect, Unnamed, Verdict
from sci_lightning.files.json_file import says
from sci_lightning.studies.engine.records import CaseRecord, FailedCase, Records, digest_of
from sci_lightning.studies.engine.run_cases import run_cases
from sci_lightning.studies.proving_ground.outcome import names_meant
from sci_lightning.studies.proving_ground.reliability import Statement, statements
from tests.textbook_camera.recording import save
from tests.textbook_camera.suite import cases, record, seed_of

SIZE = 64


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


def every_case(round_: int) -> list[Trial]:
    """Return all cases of a round."""
    return [Trial(round_, number) for number in range(1, len(cases(round_)) + 1)]


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
