"""The tables of a round of the textbook camera and of the proving ground: how often a diagnosis is right.

``python -m tests.textbook_camera.tables ROUND COMMIT OUT`` writes files of ``docs/results`` from the records of a round
in ``OUT/cases``; ``--ground DIR`` adds those of the proving ground of the same commit, ``--former DIR`` those of the
same round by the rules of an earlier version. ``tests/textbook_camera/round-7`` is the ``OUT`` of round 7;
``round-6/faint`` was a ``--ground``, and ``round-5/former`` are the rules before.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.studies.engine.records import Records
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.pictures import reliability_figure
from sci_lightning.studies.proving_ground.reliability import Statement, reliability
from sci_lightning.studies.proving_ground.summary import CERTAIN, VISIBLE_GAIN
from tests.measurements_file import Column, MeasurementsFile, in_words, proportion_in_words
from tests.textbook_camera.score import SIZE, TrialRecord, every_case
from tests.textbook_camera.suite import GROUPS

RESULTS = Path("docs/results")
STANDARD_DEVIATIONS = 1.959964
"""Half the width of the 95 % interval of a normal distribution."""
COLUMNS: list[Column] = [
    ("world", "world", None),
    ("hidden", "hidden", None),
    ("exact", "exact", None),
    ("wrong", "wrong name", None),
    ("missed", "missed", None),
    ("stage", "stage right", None),
    ("agrees", "agrees", None),
    ("median", "seconds", 0),
    ("longest", "longest", 0),
]
RELIABILITY: list[Column] = [
    ("stated", "stated probability", None),
    ("mean", "on average", 3),
    ("true", "true", None),
]


@dataclass(frozen=True)
class Answer:
    """What every table asks of a case.

    Attributes:
        group: nothing, single, pair, triple or outside.
        exact: whether exactly what is hidden is named, or a class that holds it.
        named: probability and whether it is right of every name.
        errors: of the estimates, in stated standard deviations.
        seconds: of a processor.
        statements: with a probability.
    """

    group: str
    exact: bool
    named: Sequence[tuple[float | None, bool]]
    errors: Sequence[float]
    seconds: float
    statements: Sequence[Statement]

    @classmethod
    def of_textbook(cls, one: TrialRecord) -> Answer:
        """Return the answer of a case of the textbook camera."""
        named = [(effect.probability, not one.is_wrong(effect)) for effect in one.named]
        exact = not one.missed and all(right for _, right in named)
        errors = [error for _, error in one.errors]
        return cls(one.truth["group"], exact, named, errors, one.cpu_seconds, one.statements)

    @classmethod
    def of_proving_ground(cls, one: Outcome) -> Answer:
        """Return the answer of a case of the proving ground."""
        named = [(effect.probability, effect.name not in one.wrong_names) for effect in one.named]
        errors = [error for _, error in one.errors]
        return cls(one.suite, one.exact, named, errors, one.cpu_seconds, one.statements)

    @property
    def wrong(self) -> bool:
        """Whether a name is wrong."""
        return not all(right for _, right in self.named)


def row(world: str, group: str, records: Sequence[TrialRecord]) -> dict[str, Any]:
    """Return what was right and wrong in the cases of one world and one group."""
    answers = [Answer.of_textbook(one) for one in records]
    hidden = sum(bool(one["accepted"]) for record in records for one in record.hidden)
    unnamed = [one for one in records if one.truth["group"] == "outside"]
    return {
        "world": world,
        "hidden": group,
        "exact": in_words(one.exact for one in answers),
        "wrong": in_words(one.wrong for one in answers),
        "missed": f"{sum(len(one.missed) for one in records)} of {hidden}" if hidden else "",
        "stage": f"{sum(one.stage_is_right for one in unnamed)} of {len(unnamed)}" if unnamed else "",
        "agrees": f"{sum(one.verdict in ('consistent', 'explained') for one in records)} of {len(records)}",
        "median": float(np.median([one.seconds for one in answers])),
        "longest": max(one.seconds for one in answers),
    }


def rows(records: Sequence[TrialRecord]) -> list[dict[str, Any]]:
    """Return the rows of the table of a round."""
    groups = {
        (world, group): [one for one in records if (one.truth["world"], one.truth["group"]) == (world, group)]
        for world in ("clean", "laboratory")
        for group in GROUPS
    }
    return [row(*key, some) for key, some in groups.items() if some]


def share(answers: Iterable[bool]) -> str:
    """Return how many of how many are true, "9/10"; empty of none."""
    listed = list(answers)
    return f"{sum(listed)}/{len(listed)}" if listed else ""


HIDDEN = {"nothing": "nothing hidden", "single": "one effect", "pair": "two", "triple": "three"}


def figures(answers: Sequence[Answer]) -> dict[str, str]:
    """Return the column of the short table that some cases make, by what is asked."""
    exact = {group: share(one.exact for one in answers if one.group == group) for group in HIDDEN}
    return {
        **{
            f"{what}: {'nothing' if group == 'nothing' else 'exactly'} named": exact[group]
            for group, what in HIDDEN.items()
        },
        "with a wrong name": share(one.wrong for one in answers),
        "names stated with 95 % and more: right": share(
            right for one in answers for probability, right in one.named if (probability or 0.0) >= CERTAIN
        ),
        "95 % intervals that hold": share(abs(error) <= STANDARD_DEVIATIONS for one in answers for error in one.errors),
    }


def short_table(columns: dict[str, Sequence[Answer]]) -> list[dict[str, Any]]:
    """Return the short table: a row for every figure, a column for every world."""
    by_column = {name: figures(some) for name, some in columns.items()}
    return [{"what": what} | {name: by_column[name][what] for name in columns} for what in figures(())]


def of_round(out: Path, round_: int) -> list[TrialRecord]:
    """Return the records of a round that are there."""
    records = Records(out / "cases", TrialRecord)
    return [one for one in map(records.ended, every_case(round_)) if isinstance(one, TrialRecord)]


def main(round_: int, commit: str, out: Path, ground: Path | None = None, former: Path | None = None) -> None:
    textbook, total = of_round(out, round_), len(every_case(round_))
    if len(textbook) < total:
        sys.exit(f"{len(textbook)} of {total} cases have a record; the tables need all of them")
    about = {
        "machine": "one thread, two cases at a time",
        "scale": f"{total} cameras, 34 captures of {SIZE} x {SIZE} pixels, eight slots",
        "seeds": f"round {round_}",
        "commit": commit,
        "command": f"python -m tests.textbook_camera.score OUT {round_}",
    }
    MeasurementsFile(RESULTS / f"textbook-{round_}.json", **about).write(COLUMNS, rows(textbook))
    worlds = {"textbook camera": "clean", "the same in a laboratory": "laboratory"}
    columns = {
        title: [Answer.of_textbook(one) for one in textbook if one.truth["world"] == world]
        for title, world in worlds.items()
    }
    doubtful, of_textbook = list[Statement](), dict(about)
    if ground is not None:
        outcomes = list(Records(ground / "cases", Outcome).read())
        asked = [one for one in outcomes if one.suite not in ("weak", "faint", "later")]
        asked = [one for one in asked if not one.hidden or one.suite == "outside" or one.smallest_gain >= VISIBLE_GAIN]
        for title, formulation in {"proving ground": "overlap", "the same, imperfect": "rays"}.items():
            if some := [Answer.of_proving_ground(one) for one in asked if one.formulation == formulation]:
                columns[title] = some
        doubtful = [statement for one in outcomes if one.suite == "faint" for statement in one.statements]
        about["scale"] += f", and {len(outcomes)} of the proving ground"
        about["seeds"] += f", and rounds from {min(int(one.case.rpartition('-')[2]) for one in outcomes)}"
        about["command"] += " and python -m sci_lightning.proving_ground first_round=.."
    described: list[Column] = [("what", "", None), *((title, title, None) for title in columns)]
    shown = about if len(columns) > len(worlds) else of_textbook
    MeasurementsFile(RESULTS / "diagnosis-summary.json", **shown).write(described, short_table(columns))
    usual = [one for some in columns.values() for answer in some for one in answer.statements]
    table = [
        {"stated": f"{one.low:g} to {one.high:g}", "mean": one.stated, "true": proportion_in_words(one.true)}
        for one in reliability([*usual, *doubtful])
    ]
    MeasurementsFile(RESULTS / "diagnosis-reliability.json", **about).write(RELIABILITY, table)
    figure = reliability_figure(
        {"clear effects, or nothing": usual} | ({"faint effects": doubtful} if doubtful else {})
    )
    figure.savefig(RESULTS / "diagnosis-reliability.png", dpi=130)
    if former is not None:
        before = of_round(former, round_)
        numbers = {one.number for one in before}
        same = [one for one in textbook if one.number in numbers]
        table = [
            {"rules": name, **row("", "", some)} for name, some in (("before", before), (f"of round {round_}", same))
        ]
        table = [{key: one[key] for key in ("rules", "exact", "wrong", "missed", "stage")} for one in table]
        scale = {"scale": about["scale"].replace(str(total), str(len(same)), 1)}
        MeasurementsFile(RESULTS / f"textbook-{round_}-former.json", **about | scale).write(
            [("rules", "rules", None), *COLUMNS[2:6]], table
        )


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("round_", type=int, metavar="ROUND")
    parser.add_argument("commit", metavar="COMMIT")
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--ground", type=Path)
    parser.add_argument("--former", type=Path)
    main(**vars(parser.parse_args()))
