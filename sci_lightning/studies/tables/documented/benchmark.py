"""Tables of a ``benchmark.json``: ``benchmark.counts``, ``.forward``, ``.training`` and ``.machine``."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json
from sci_lightning.studies.benchmark.benchmark_file import Benchmark
from sci_lightning.studies.benchmark.table import tables
from sci_lightning.studies.tables.documentation import DocumentedTable


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return a table of a file that ``python -m sci_lightning.benchmark`` wrote.

    Raises:
        BadInput: another format, or a table that the file has no figures for.
    """
    benchmark = read_json(path, Benchmark)
    present = tables(benchmark.as_json())
    if part not in present:
        raise BadInput(f"{path}: no table benchmark.{part}; choose benchmark.{', benchmark.'.join(present)}")
    heading, *body = present[part]
    decoded = [f"Decoded: {benchmark.scene}, {benchmark.weights}."] if part == "forward" else []
    return DocumentedTable(heading, body, benchmark.provenance, decoded)
