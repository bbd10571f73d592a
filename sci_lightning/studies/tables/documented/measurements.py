"""Any table of figures: columns with their digits, rows with their values."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import JsonFile, JsonObject, Number, read_json, says
from sci_lightning.runs.provenance import Provenance
from sci_lightning.studies.tables.documentation import DocumentedTable

Cell = Number | str | list[Number]


class Column(JsonObject):
    """A column of a table."""

    key: str = says("by which rows hold their value")
    title: str = says("the heading, Markdown, with the unit")
    digits: int | list[int] = says("after the decimal point; a list for values that are lists", default=0)


class Measurements(JsonFile):
    """``docs/results/*.json``: a measured table of the documentation."""

    format: Literal["sci-measurements"]
    format_version: Literal[1]
    provenance: Provenance = says("of the figures")
    columns: list[Column] = says("in their order")
    rows: list[dict[str, Cell]] = says("values by the column's key: a number, Markdown, or numbers; absent: empty")
    notes: list[str] = says("sentences below the table, Markdown", default=[])


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return the table of a file of :class:`Measurements`; a list of numbers is shown as ``26.67 / .811``.

    Raises:
        BadInput: another format, a value without a column, or digits that do not fit the values.
    """
    table = read_json(path, Measurements)
    keys = {column.key for column in table.columns}
    if unknown := sorted({key for row in table.rows for key in row} - keys):
        raise BadInput(f"{path}: rows hold {', '.join(unknown)}, which no column shows")
    cells = [[_cell(row.get(column.key), column, path) for column in table.columns] for row in table.rows]
    return DocumentedTable([column.title for column in table.columns], cells, table.provenance, list(table.notes))


def _cell(value: Cell | None, column: Column, path: str | Path) -> str:
    """Return a value as the table shows it, numbers with the column's digits."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    values, digits = (part if isinstance(part, list) else [part] for part in (value, column.digits))
    if len(values) != len(digits):
        raise BadInput(f"{path}: {column.key} has {len(values)} values and digits for {len(digits)}")
    return " / ".join(f"{number:,.{places}f}" for number, places in zip(values, digits, strict=True))
