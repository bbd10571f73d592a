"""The paper's tables with our kept rows in them, and verdicts on its claims.

``paper.table5`` is one of the tables, ``paper.psnr`` all of them in short, ``paper.trained`` what of this has been
trained, ``paper.verdicts`` a line for each claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import in_markdown
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.tables.claim_table import claim_table, verdict_table
from sci_lightning.studies.tables.grid import DocumentedTable, Grid
from sci_lightning.studies.tables.line import Line, lines_of
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.run import ScoredRun, find_runs
from sci_lightning.studies.tables.score_table import HEADING, SCORES, score_table

OURS = HEADING.index(f"ours: {SCORES}")
"""Column of our scores in the paper's tables."""
ENCODERS = {
    ("rbw_osr", "rbw_osr"): "RBw/oSR",
    ("rbw_osr", "rbw_sr"): "RBw/oSR, tested through RBw/SR",
    ("rbw_sr", "rbw_sr"): "RBw/SR",
    ("rsw_sr", "rsw_sr"): "RSw/SR",
    ("lsw_sr", "lsw_sr"): "LSw/SR",
}
"""Columns of the table of all PSNRs, by the encoders of training and test."""
PSNR_NOTE = (
    "PSNR in dB, the paper's in brackets; behind ±: the standard deviation over the seeds. "
    "Masks of LSw/SR have 4 bits where the row does not say otherwise."
)


def paper_table(path: str | Path, part: str) -> DocumentedTable:
    """Return one of the paper's tables, or its claims, with the rows that are kept in a folder.

    Args:
        path: the folder, such as ``docs/results/tables/cpu``; as long as it is not there, the table is empty.
        part: ``table2`` to ``table5``, ``psnr`` (the PSNR of these four, a line for each decoder), ``trained`` (the
            PSNR of the rows that are there), ``claims`` (every comparison) or ``verdicts`` (a line for each claim).

    Raises:
        BadInput: another part, or a file of no use.
    """
    path = Path(path)
    paper = paper_figures()
    runs, lines = find_runs([path]) if path.is_dir() else ([], [])
    if lines:
        raise BadInput(lines[0])
    if part in ("claims", "verdicts"):
        scored = [claim for claim in paper["claims"] if "cost" not in claim]
        grid = (claim_table if part == "claims" else verdict_table)(scored, paper["tables"], runs)
    elif part in ("psnr", "trained"):
        grid = (_psnr if part == "psnr" else _trained_psnr)(paper["tables"], runs)
    elif part in paper["tables"]:
        table = {key: value for key, value in paper["tables"][part].items() if key != "cost"}
        grid = _trained(score_table(part, table, runs))
    else:
        parts = [*paper["tables"], "psnr", "trained", "claims", "verdicts"]
        raise BadInput(f"paper.{part}: no such table; choose one of {', '.join(parts)}")
    return DocumentedTable(*_cells(grid), _provenance(runs), [in_markdown(note) for note in grid.notes])


def _trained(grid: Grid) -> Grid:
    """Return a table of scores without the rows that have not been trained; an empty one stays as it is."""
    rows = [row for row in grid.rows if row[OURS]]
    if not rows or len(rows) == len(grid.rows):
        return grid
    return replace(grid, rows=rows, notes=["Rows that have not been trained yet are left out.", *grid.notes])


def _psnr(tables: Mapping[str, Any], runs: Sequence[ScoredRun]) -> Grid:
    """The PSNR of Tables 2 to 5 in one: decoders below each other, pairs of encoders side by side."""
    cells: dict[str, dict[str, list[str]]] = {}
    for name, encoder, line in _named_lines(tables, runs):
        texts = cells.setdefault(name, {column: [] for column in ENCODERS.values()})[encoder]
        if (text := _psnr_cell(line)) not in texts:
            texts.append(text)
    rows = [[name, *("; ".join(texts) for texts in row.values())] for name, row in cells.items()]
    return Grid("psnr", "Tables 2 to 5: PSNR", ["decoder", *ENCODERS.values()], rows, [PSNR_NOTE])


def _trained_psnr(tables: Mapping[str, Any], runs: Sequence[ScoredRun]) -> Grid:
    """The PSNR of what was trained, and nothing else: a line for each decoder and encoder."""
    rows = {
        (name, encoder): [name, encoder, f"{psnr:.2f}", f"{line.paper['psnr']:.2f}"]
        for name, encoder, line in _named_lines(tables, runs)
        if (psnr := line.mean().get("psnr")) is not None
    }
    return Grid("psnr", "PSNR", ["decoder", "camera", "ours (dB)", "the paper's (dB)"], list(rows.values()), [])


def _named_lines(tables: Mapping[str, Any], runs: Sequence[ScoredRun]) -> Iterator[tuple[str, str, Line]]:
    """Yield every line of Tables 2 to 5 after the names of its decoder and of its encoder."""
    by_bits = {fields["decoder"] for fields in tables["table5"]["columns"].values()}
    names = {row["match"]["decoder"]: name for key in ("table2", "table4") for name, row in tables[key]["rows"].items()}
    for key in ("table2", "table3", "table5", "table4"):  # Table 4 repeats Table 5's learned mask of 4 bits
        for line in lines_of(tables[key], runs):
            fields = {**tables[key]["columns"][line.column], **tables[key]["rows"][line.row]["match"]}
            name = names[line.decoder] + (f", {fields['bits']}-bit mask" if line.decoder in by_bits else "")
            yield name, ENCODERS[fields["encoder"], fields["test_encoder"]], line


def _psnr_cell(line: Line) -> str:
    """Our PSNR, if there is one, and the paper's in brackets."""
    ours, spread = line.mean().get("psnr"), line.spread().get("psnr")
    text = "" if ours is None else f"{ours:.2f} " + ("" if spread is None else f"± {spread:.2f} ")
    return f"{text}({line.paper['psnr']:.2f})"


def _cells(grid: Grid) -> tuple[list[str], list[list[str]]]:
    """The heading and the rows as Markdown."""
    heading, *rows = [[in_markdown(cell) for cell in row] for row in (grid.heading, *grid.rows)]
    return heading, rows


def _provenance(runs: list[ScoredRun]) -> Provenance:
    if not runs:
        return NOT_YET
    if missing := [run.path for run in runs if run.provenance is None]:
        raise BadInput(f"{missing[0]}: does not say where, when and with what it was trained (provenance)")
    return joined([run.provenance for run in runs if run.provenance])
