"""The kinds of tables of README.md and docs/: each is a function of a path and of a part of its name.

``<!-- table: benchmark.forward, from docs/results/benchmark/a.json -->`` calls :func:`benchmark` with that path and
``forward``. A new kind is one function here; many tables need none, because ``measurements`` shows any JSON of its
format. A folder of results may be absent: as long as it is, its table is empty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import JsonFile, JsonObject, Number, read_json, says
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.benchmark.benchmark_file import Benchmark
from sci_lightning.studies.benchmark.table import tables
from sci_lightning.studies.mismatch.records import read_records
from sci_lightning.studies.mismatch.summary import blind_table, diagnosed_blind, finetuning_table, summary_table
from sci_lightning.studies.tables.documented_paper import paper_table
from sci_lightning.studies.tables.grid import DocumentedTable

Records = Sequence[Mapping[str, Any]]
Rows = list[list[str]]

LEFT_OUT = ("GFLOP/s", "of matmul")
"""Columns of benchmarks that pages have no room for."""


def benchmark(path: str | Path, part: str) -> DocumentedTable:
    """Return a table of a file that ``python -m sci_lightning.benchmark`` wrote.

    Args:
        path: of the file (in the format ``Benchmark``).
        part: ``counts``, ``forward``, ``training`` or ``machine``.

    Raises:
        BadInput: another format, or a table that the file has no figures for.
    """
    measured = read_json(path, Benchmark)
    present = tables(measured.as_json())
    if part not in present:
        raise BadInput(f"{path}: no table benchmark.{part}; choose benchmark.{', benchmark.'.join(present)}")
    heading, *body = [
        [cell for title, cell in zip(present[part][0], row, strict=True) if title not in LEFT_OUT]
        for row in present[part]
    ]
    return DocumentedTable(heading, body, measured.provenance)


def table_of_records(
    path: str | Path, part: str, table: Callable[[Records], Rows], chosen: Callable[[Records], Records] = list
) -> DocumentedTable:
    """Return a table of the mismatch protocol, or of the fine-tunings after it.

    Args:
        path: a folder of records.
        part: must be empty.
        table: returns heading and rows, the heading alone without records.
        chosen: returns the records that the table shows.

    Raises:
        BadInput: a file that is no record, or a part.
    """
    if part:
        raise BadInput(f"{part}: this table has no parts")
    records = chosen(read_records(path)) if Path(path).is_dir() else []
    origins = [Provenance(**record["provenance"]) for record in records]
    heading, *rows = table(records)
    return DocumentedTable(heading, rows, joined(origins) if origins else NOT_YET)


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


def measurements(path: str | Path, part: str) -> DocumentedTable:
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


KINDS: dict[str, Callable[[Path, str], DocumentedTable]] = {
    "benchmark": benchmark,
    "blind_mismatch": partial(table_of_records, table=blind_table, chosen=diagnosed_blind),
    "finetuning": partial(table_of_records, table=finetuning_table),
    "measurements": measurements,
    "mismatch": partial(table_of_records, table=partial(summary_table, published=True)),
    "paper": paper_table,
}
"""The kinds by the names that pages use."""
