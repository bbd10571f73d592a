"""The paper's claims about its tables, and whether our runs bear them out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sci_lightning.tables.grid import Grid
from sci_lightning.tables.line import Line, lines_of
from sci_lightning.tables.run import Run
from sci_lightning.tables.score_table import less, partner, seeds, together

HEADING = ["claim", "row", "ours (dB)", "the paper's (dB)", "verdict", "scale", "seeds"]
NOTE = (
    "Differences of PSNR. A verdict within the spread of the seeds, or of one seed alone, is none to rely on. "
    "Not trained enough: one of the two is no better than the mean measurement in every frame."
)


def claim_table(claims: Sequence[Mapping[str, Any]], tables: Mapping[str, Any], runs: Sequence[Run]) -> Grid:
    """Every claim, row by row: how far what the paper puts ahead is ahead.

    Args:
        claims, tables: of ``paper_figures.yaml``.
        runs: ours.
    """
    lines = {name: lines_of(table, runs) for name, table in tables.items()}
    rows = []
    for claim in claims:
        for ahead, behind in _pairs(claim, lines):
            rows += [[claim["claim"], *row] for row in _rows(ahead, behind)]
    return Grid("claims", "What the paper claims of its tables", HEADING, rows, [NOTE])


def _pairs(claim: Mapping[str, Any], lines: Mapping[str, list[Line]]) -> Iterator[tuple[list[Line], list[Line]]]:
    """The lines of each row that is ahead, and those of the row that it is ahead of."""
    cells = []
    for side in ("ahead", "behind"):
        table, names, column = claim[side]
        groups: dict[str, list[Line]] = {}
        for line in lines[table]:
            if line.column == column and (names == "each" or line.row in names):
                groups.setdefault(line.row, []).append(line)
        cells.append(groups)
    ahead, behind = cells
    for row, group in ahead.items():
        if claim["behind"][1] != "each":
            yield from ((group, other) for other in behind.values())
        elif row in behind:
            yield group, behind[row]


def _rows(ahead: Sequence[Line], behind: Sequence[Line]) -> list[list[str]]:
    """A row for each setting that both were run in, or one that says that there is none."""
    one, other = ahead[0], behind[0]
    row = one.row if one.row == other.row else f"{one.row}, {other.row}"
    paper = f"{one.paper['psnr'] - other.paper['psnr']:+.2f}"
    rows = []
    for line in ahead:
        match = partner(line, behind) if line.runs else None
        if match is not None and {"psnr"} <= line.mean().keys() & match.mean().keys():
            gap = less(line.mean(), match.mean())["psnr"]
            spread = together(line.spread(), match.spread()).get("psnr")
            ours = f"{gap:+.2f}" + ("" if spread is None else f" ± {spread:.2f}")
            verdict = "reproduced" if gap > 0 else "not reproduced"
            if not (line.learned() and match.learned()):
                verdict = "not trained enough"
            elif spread is not None and abs(gap) < spread:
                verdict += ", within the spread"
            rows.append([row, ours, paper, verdict, str(line.runs[0].setting), seeds(line.runs, match.runs)])
    return rows or [[row, "", paper, "not yet run", "", ""]]
