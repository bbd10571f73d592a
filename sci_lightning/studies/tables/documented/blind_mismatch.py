"""What blind diagnoses are worth, from the records of the mismatch protocol: ``blind_mismatch``."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.mismatch.blind_summary import blind_table, diagnosed_blind
from sci_lightning.studies.mismatch.records import read_records
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return the table of a folder of records: PSNR in dB with and without one factor of brightness, and the names.

    Args:
        path: the folder; as long as it is not there, the table is empty.
        part: must be empty.

    Raises:
        BadInput: a file that is no record, or a part.
    """
    path = Path(path)
    if part:
        raise BadInput(f"blind_mismatch.{part}: this table has no parts")
    records = diagnosed_blind(read_records(path)) if path.is_dir() else []
    heading, *rows = blind_table(records)
    origins = [Provenance(**record["provenance"]) for record in records]
    return DocumentedTable(heading, rows, joined(origins) if origins else NOT_YET)
