"""``summary.md`` and ``summary.json`` of a proving ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_file import JsonFile, JsonObject, says, write_json
from sci_lightning.plain_text import markdown_table
from sci_lightning.runs.provenance import Provenance, installed_version
from sci_lightning.studies.engine import FailedCase
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.summary import SuiteScore

ANSWERS = {True: "yes", False: "**no**", None: ""}


class SummaryRow(JsonObject):
    """One figure; of a proportion how many of how many."""

    what: str = says("what is measured")
    figure: str = says("in words", alias="found")
    target: str = says("what it should be, in words; absent where there is no target", default="")
    met: bool | None = says("whether the figure reaches the target; absent without cases or target", default=None)
    count: int = says("of a proportion: how many of total", ge=0, default=0)
    total: int = says("of a proportion: number of cases", ge=1, default=1)
    interval: tuple[float, float] = says("of a proportion: 95 % by Wilson's score", default=(0, 1))
    missed: list[str] = says("cases that count against the row, a line each")


class Summary(JsonFile):
    """``summary.json``: how often diagnoses are right; ``summary.md`` beside it is the same for people."""

    format: Literal["sci-proving-ground"] = "sci-proving-ground"
    format_version: Literal[1] = 1
    provenance: Provenance | None = says("of the cases; absent where their records do not say", default=None)
    rows: list[SummaryRow]
    sci_lightning: str = says("version of the program")


def write_report(out: str | Path, rows: Sequence[SuiteScore], provenance: Provenance | None = None) -> None:
    """Write both files into the folder ``out``; neither is ever half written.

    Args:
        out: the folder.
        rows: of the summary.
        provenance: of the cases; None if it is not known.
    """
    out = Path(out)
    with atomic_write(out / "summary.md") as temporary:
        temporary.write_text(as_markdown(rows))
    content = {
        **({"provenance": provenance.as_json()} if provenance else {}),
        "rows": [as_plain_data(row) for row in rows],
        "sci_lightning": installed_version(),
    }
    write_json(Summary.model_validate(content).as_json(), out / "summary.json")


def provenance_of(records: Sequence[Outcome | FailedCase], command: str = "") -> Provenance | None:
    """Return where, when and with which versions of the program the cases were run; None where none of them says so."""
    outcomes = [record for record in records if isinstance(record, Outcome) and record.provenance.date]
    if not outcomes:
        return None
    dates = sorted({outcome.provenance.date for outcome in outcomes})
    sizes = " and ".join(f"{height} x {width}" for height, width in sorted({outcome.size for outcome in outcomes}))
    return Provenance(
        machine=", ".join(dict.fromkeys(outcome.provenance.machine for outcome in outcomes)),
        date=" to ".join(dict.fromkeys((dates[0], dates[-1]))),
        commit=", ".join(dict.fromkeys(sorted({outcome.provenance.commit for outcome in outcomes}))),
        scale=f"{len(records)} cases of {sizes} pixels",
        seeds="one of its own in every case",
        command=command,
    )


def as_markdown(rows: Sequence[SuiteScore]) -> str:
    """Return the table, then which targets were missed, then every case that counts against a row."""
    cells = [[row.what, row.figure, row.target, ANSWERS[row.met]] for row in rows]
    lines = [markdown_table(["what", "found (95 % interval)", "target", "reached"], cells)]
    missed = [f"- {row.what}: {row.figure}; the target is {row.target}." for row in rows if row.met is False]
    lines += ["", "## What fell short", "", *(missed or ["Nothing."])]
    if not_tried := [row.what for row in rows if row.figure == "no cases"]:
        lines += ["", f"Not tried: {'; '.join(not_tried)}."]
    for row in rows:
        if row.missed:
            lines += ["", f"### {row.what}", "", *(f"- {case}" for case in row.missed)]
    return "\n".join(lines) + "\n"


def as_plain_data(row: SuiteScore) -> dict[str, Any]:
    """Return a row as plain data for JSON; keys without a value are absent."""
    content: dict[str, Any] = {"what": row.what, "found": row.figure}
    if row.target:
        content["target"] = row.target
    if row.met is not None:
        content["met"] = row.met
    if row.proportion and row.proportion.total:
        count, total, interval = row.proportion.count, row.proportion.total, row.proportion.interval
        content |= {"count": count, "total": total, "interval": interval}
    return content | {"missed": list(row.missed)}
