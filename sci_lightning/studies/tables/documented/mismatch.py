"""The records of the mismatch protocol, which ``python -m sci_lightning.mismatch`` writes: ``mismatch``."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.mismatch.records import read_records
from sci_lightning.studies.mismatch.summary import summary_table
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return the table of a folder of records: mean PSNR in dB of the scenes, by camera, decoder and scenario.

    Args:
        path: the folder; as long as it is not there, the table is empty.
        part: empty: all cameras; else the beginning of the cameras' names: ``published``, ``drawn`` or ``alone``.

    Raises:
        BadInput: a file that is no record, or no record of this part.
    """
    path = Path(path)
    records = [record for record in read_records(path) if record["camera"].startswith(part)] if path.is_dir() else []
    if path.is_dir() and not records:
        raise BadInput(f"{path}: no records of {part or 'any'} cameras; copy cases/ of a run into it")
    heading, *rows = summary_table(records, published=True)
    origins = [Provenance(**record["provenance"]) for record in records]
    return DocumentedTable(heading, rows, joined(origins) if origins else NOT_YET)
