"""The paper's tables with our kept rows in them, and verdicts on its claims: ``paper.table5``, ``paper.verdicts``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import yaml

from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.errors import BadInput
from sci_lightning.files.json_fields import read_json
from sci_lightning.files.plain_text import in_markdown
from sci_lightning.tables.claim_table import claim_table, verdict_table
from sci_lightning.tables.documentation import DocumentedTable
from sci_lightning.tables.grid import Grid
from sci_lightning.tables.provenance import NOT_YET, Provenance, joined, read_provenance
from sci_lightning.tables.run import Run, find_runs
from sci_lightning.tables.score_table import HEADING, SCORES, score_table

OURS = HEADING.index(f"ours: {SCORES}")
"""Column of our scores in the paper's tables."""


def build(path: str | Path, part: str) -> DocumentedTable:
    """Return one of the paper's tables, or its claims, with the rows that are kept in a folder.

    Args:
        path: the folder, such as ``docs/results/tables/cpu``; as long as it is not there, the table is empty.
        part: ``table2`` to ``table5``, ``claims`` (every comparison) or ``verdicts`` (a line for each claim).

    Raises:
        BadInput: another part, or a file of no use.
    """
    path = Path(path)
    paper = yaml.safe_load((PACKAGE / "tables" / "paper_figures.yaml").read_text())
    runs, lines = find_runs([path]) if path.is_dir() else ([], [])
    if lines:
        raise BadInput(lines[0])
    if part in ("claims", "verdicts"):
        scored = [claim for claim in paper["claims"] if "cost" not in claim]
        grid = (claim_table if part == "claims" else verdict_table)(scored, paper["tables"], runs)
    elif part in paper["tables"]:
        table = {key: value for key, value in paper["tables"][part].items() if key != "cost"}
        grid = _trained(score_table(part, table, runs))
    else:
        raise BadInput(
            f"paper.{part}: no such table; choose one of {', '.join([*paper['tables'], 'claims', 'verdicts'])}"
        )
    return DocumentedTable(*_cells(grid), _provenance(runs), [in_markdown(note) for note in grid.notes])


def _trained(grid: Grid) -> Grid:
    """Return a table of scores without the rows that have not been trained; an empty one stays as it is."""
    rows = [row for row in grid.rows if row[OURS]]
    if not rows or len(rows) == len(grid.rows):
        return grid
    return replace(grid, rows=rows, notes=["Rows that have not been trained yet are left out.", *grid.notes])


def _cells(grid: Grid) -> tuple[list[str], list[list[str]]]:
    """The heading and the rows as Markdown."""
    heading, *rows = [[in_markdown(cell) for cell in row] for row in (grid.heading, *grid.rows)]
    return heading, rows


def _provenance(runs: list[Run]) -> Provenance:
    if not runs:
        return NOT_YET
    return joined([read_provenance(read_json(run.path)) for run in runs])
