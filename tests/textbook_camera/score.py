"""Diagnose a round of the textbook camera and count: ``python -m tests.textbook_camera.score OUT ROUND [FIRST LAST]``.

Every case leaves a record in ``OUT/cases``; the same line goes on where it ended. Round 0 is for development; any other
one is sealed, and is run once.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
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
from tests.textbook_camera.recording import save
from tests.textbook_camera.suite import cases, record, seed_of

SIZE = 64
QUANTILES = {"50 %": 0.674490, "80 %": 1.281552, "95 %": 1.959964}
"""Half the widths of intervals of a normal distribution, in standard deviations."""


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
    def missed(self) -> list[str]:
        """Hidden effects with a name that the diagnosis did not name."""
        return [one["deviation"] for one in self.hidden if one["accepted"] and self.meant(one) is None]

    def is_wrong(self, effect: NamedEffect) -> bool:
        """Whether no member of a name's class is true or tolerated."""
        right = {name for one in self.hidden for name in (*(one["accepted"] or ()), *one["tolerated"])}
        return right.isdisjoint(names_meant(effect))

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
        "not_tried": report["budget"]["not_tried"],
        "cpu_seconds": time.process_time() - begun,
    }


def summary(records: Sequence[TrialRecord]) -> list[str]:
    """Return lines: names right, missed and wrong by world and group, coverage, and stated probabilities."""
    lines = []
    for world in ("clean", "laboratory"):
        for group in ("nothing", "single", "pair", "triple", "outside"):
            some = [one for one in records if (one.truth["world"], one.truth["group"]) == (world, group)]
            if some:
                exact = sum(not one.missed and not any(map(one.is_wrong, one.named)) for one in some)
                wrong = sum(any(map(one.is_wrong, one.named)) for one in some)
                lines.append(f"{world}, {group}: {exact} of {len(some)} exact, {wrong} with a wrong name")
        errors = [error for one in records if one.truth["world"] == world for _, error in one.errors]
        if errors:
            held = (f"{label} {sum(abs(e) <= width for e in errors)}" for label, width in QUANTILES.items())
            lines.append(f"{world}: intervals of {len(errors)} parameters that hold: {', '.join(held)}")
    stated = [(one.is_wrong(effect), effect.probability) for one in records for effect in one.named]
    for low, high in ((0.5, 0.8), (0.8, 0.95), (0.95, 0.999), (0.999, 1.01)):
        inside = [wrong for wrong, probability in stated if probability is not None and low <= probability < high]
        if inside:
            lines.append(f"probability {low} to {min(high, 1)}: {len(inside) - sum(inside)} of {len(inside)} right")
    times = sorted(one.cpu_seconds for one in records)
    return [*lines, f"processor time: median {times[len(times) // 2]:.0f} s, longest {times[-1]:.0f} s"]


def main(out: Path, round_: int, first: int, last: int) -> None:
    records = Records(out / "cases", TrialRecord)
    for ended in run_cases(work, [Trial(round_, number) for number in range(first, last + 1)], records, workers=1):
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
    kept = [records.ended(Trial(round_, number)) for number in range(first, last + 1)]
    print(*summary([one for one in kept if isinstance(one, TrialRecord)]), sep="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), *(map(int, sys.argv[3:5] if len(sys.argv) > 3 else ("1", "64"))))
