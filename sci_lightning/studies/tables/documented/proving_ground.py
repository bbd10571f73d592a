"""Tables of a proving ground's folder: ``proving_ground.summary``, ``.outside`` and ``.rays``."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json
from sci_lightning.runs.provenance import NOT_YET, Provenance
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.records import Records
from sci_lightning.studies.proving_ground.report import ANSWERS, Summary
from sci_lightning.studies.proving_ground.summary import summarise
from sci_lightning.studies.tables.documentation import DocumentedTable
from sci_lightning.virtual_camera import OTHER_FIELDS

PARTS = ("summary", "outside", "rays")


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return a table of the cases that ``python -m sci_lightning.proving_ground`` left in a folder.

    Args:
        path: of the folder with ``cases.jsonl`` and ``summary.json``; as long as it is not there, the table is empty.
        part: ``summary`` (every figure), ``outside`` (a line for each case with a deviation known from other fields)
            or ``rays`` (a line for each case that was sampled by rays and in which a name is missing or wrong).

    Raises:
        BadInput: another part, or a file of no use.
    """
    path = Path(path)
    if part not in PARTS:
        raise BadInput(f"proving_ground.{part}: no such table; choose proving_ground.{', proving_ground.'.join(PARTS)}")
    records = Records(path / "cases.jsonl").read()
    outcomes = [record for record in records if isinstance(record, Outcome)]
    provenance = _provenance(path) if records else NOT_YET
    if part == "summary":
        rows = [row for row in summarise(records) if row.figure != "no cases"] if records else []
        cells = [[row.what, row.figure, row.target, ANSWERS[row.met]] for row in rows]
        return DocumentedTable(["what", "result (95 % interval)", "target", "reached"], cells, provenance)
    if part == "outside":
        shown = [outcome for outcome in outcomes if set(outcome.hidden_names) & set(OTHER_FIELDS)]
    else:
        shown = [outcome for outcome in outcomes if outcome.formulation == "rays" and not outcome.exact]
    return DocumentedTable(
        [
            "hidden",
            "camera",
            "named",
            "unnamed, the strongest first",
            "captures left out",
            "verdict",
            "chi2 before",
            "after",
        ],
        [_line(outcome) for outcome in shown],
        provenance,
    )


def _line(outcome: Outcome) -> list[str]:
    named = ", ".join(f"`{effect.name}`" for effect in outcome.named)
    unnamed = ", ".join(stage.removeprefix("unnamed:") for stage in outcome.unnamed_stages)
    hidden = ", ".join(f"`{name}`" for name in outcome.hidden_names) or "nothing"
    camera = f"{outcome.mask}, {outcome.bit_depth} bits"
    left_out = ", ".join(map(str, outcome.bad_captures)) + (" (right)" if outcome.captures_right else "")
    figures = (f"{outcome.chi2_before:.3g}", f"{outcome.chi2_after:.3g}")
    verdict = outcome.verdict.replace("_", " ")
    return [hidden, camera, named, unnamed, left_out if outcome.bad_captures else "", verdict, *figures]


def _provenance(path: Path) -> Provenance:
    provenance = read_json(path / "summary.json", Summary).provenance
    if provenance is None:
        raise BadInput(f"{path}: summary.json does not say where it was measured")
    return provenance
