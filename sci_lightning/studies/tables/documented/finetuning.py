"""What fine-tuning is worth, of the records that ``python -m sci_lightning.mismatch.finetuning`` writes."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.mismatch.records import read_records
from sci_lightning.studies.mismatch.summary import finetuning_table
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return the table of a folder of records; as long as it is not there, the table is empty.

    Raises:
        BadInput: a part is asked for, or a file that is no record.
    """
    path = Path(path)
    if part:
        raise BadInput(f"finetuning.{part}: this table has no parts")
    records = read_records(path) if path.is_dir() else []
    heading, *rows = finetuning_table(records)
    origins = [Provenance(**record["provenance"]) for record in records]
    return DocumentedTable(heading, rows, joined(origins) if origins else NOT_YET)
