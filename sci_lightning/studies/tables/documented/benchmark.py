"""Tables of a ``benchmark.json``: ``benchmark.counts``, ``.forward``, ``.training`` and ``.machine``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_fields import read_json
from sci_lightning.runs.provenance import read_provenance
from sci_lightning.studies.benchmark.table import tables
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return a table of a file that ``python -m sci_lightning.benchmark`` wrote (``schemas/benchmark.json``).

    Raises:
        BadInput: another format, or a table that the file has no figures for.
    """
    path = Path(path)
    fields = read_json(path)
    content: dict[str, Any] = dict(fields.content)
    if (content.get("format"), content.get("format_version")) != ("sci-benchmark", 2):
        raise BadInput(f"{path}: expected format sci-benchmark 2")
    present = tables(content)
    if part not in present:
        raise BadInput(f"{path}: no table benchmark.{part}; choose benchmark.{', benchmark.'.join(present)}")
    heading, *body = present[part]
    decoded = [f"Decoded: {content['scene']}, {content['weights']}."] if part == "forward" else []
    return DocumentedTable(heading, body, read_provenance(fields), decoded)
