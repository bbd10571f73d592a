"""``summary.md`` and ``summary.json`` of a proving ground."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sci_lightning import __version__
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.proving_ground.summary import Row

ANSWERS = {True: "yes", False: "**no**", None: ""}


def write_report(out: str | Path, rows: Sequence[Row]) -> None:
    """Both files, each whole or absent."""
    out = Path(out)
    with whole_file(out / "summary.md") as temporary:
        temporary.write_text(markdown(rows))
    content = {
        "format": "sci-proving-ground",
        "format_version": 1,
        "rows": [plain(row) for row in rows],
        "sci_lightning": __version__,
    }
    with whole_file(out / "summary.json") as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def markdown(rows: Sequence[Row]) -> str:
    """The table, then in words what fell short, then every case that counts against a row."""
    lines = ["| what | found (95 % interval) | target | reached |", "|---|---|---|---|"]
    lines += [f"| {row.what} | {row.found} | {row.target} | {ANSWERS[row.met]} |" for row in rows]
    short = [row for row in rows if row.met is False]
    untried = [row.what for row in rows if row.found == "no cases"]
    lines += ["", "## What fell short", ""]
    lines += [f"- {row.what}: {row.found}; the target is {row.target}." for row in short] or ["Nothing."]
    if untried:
        lines += ["", f"Not tried: {'; '.join(untried)}."]
    for row in rows:
        if row.missed:
            lines += ["", f"### {row.what}", "", *(f"- {case}" for case in row.missed)]
    return "\n".join(lines) + "\n"


def plain(row: Row) -> dict[str, Any]:
    """For JSON; keys without a value are absent."""
    found: dict[str, Any] = {"what": row.what, "found": row.found}
    if row.target:
        found["target"] = row.target
    if row.met is not None:
        found["met"] = row.met
    if row.proportion and row.proportion.total:
        found |= {"count": row.proportion.count, "total": row.proportion.total, "interval": row.proportion.interval}
    return found | {"missed": list(row.missed)}
