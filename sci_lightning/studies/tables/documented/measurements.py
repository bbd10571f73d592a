"""Any table of figures: columns with their digits, rows with their values."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_fields import read_json
from sci_lightning.runs.provenance import read_provenance
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return the table of a ``sci-measurements`` file (``schemas/measurements.json``).

    ``columns`` is a list of ``{"key": .., "title": .., "digits": ..}``; a row holds by key a number, a text, or a list
    of numbers, which is shown as ``26.67 / .811``: ``digits`` is then a list as well. What a row lacks is empty.

    Raises:
        BadInput: another format, a value without a column, or digits that do not fit the values.
    """
    path = Path(path)
    content = read_json(path)
    if (content.content.get("format"), content.content.get("format_version")) != ("sci-measurements", 1):
        raise BadInput(f"{path}: expected format sci-measurements 1")
    columns: list[dict[str, Any]] = content.content["columns"]  # type: ignore[assignment]
    rows: list[dict[str, Any]] = content.content["rows"]  # type: ignore[assignment]
    keys = {column["key"] for column in columns}
    if unknown := sorted({key for row in rows for key in row} - keys):
        raise BadInput(f"{path}: rows hold {', '.join(unknown)}, which no column shows")
    cells = [[_cell(row.get(column["key"]), column, path) for column in columns] for row in rows]
    notes = [str(note) for note in content.content.get("notes", [])]  # type: ignore[attr-defined]
    return DocumentedTable([str(column["title"]) for column in columns], cells, read_provenance(content), notes)


def _cell(value: Any, column: Mapping[str, Any], path: Path) -> str:
    """Return a value as the table shows it, numbers with the column's digits."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    values, digits = (part if isinstance(part, list) else [part] for part in (value, column.get("digits", 0)))
    if len(values) != len(digits):
        raise BadInput(f"{path}: {column['key']} has {len(values)} values and digits for {len(digits)}")
    return " / ".join(f"{number:,.{places}f}" for number, places in zip(values, digits, strict=True))
