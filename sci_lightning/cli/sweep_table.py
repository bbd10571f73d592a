"""The table at the end of a sweep: what became of every row."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from sci_lightning.cli.sweep import Row
from sci_lightning.runs.results import UNITS, number

STYLES = {"skipped": "dim", "failed": "red", "unfinished": "red"}


def row_names(rows: Sequence[Row]) -> list[str]:
    """Return the overrides in which each row differs from the others; all of them for a single row."""
    common = set(rows[0].overrides).intersection(*(row.overrides for row in rows)) if len(rows) > 1 else set()
    return [" ".join(override for override in row.overrides if override not in common) for row in rows]


def sweep_table(rows: Sequence[Row]) -> Table:
    """Lay out one line for each row: the overrides in which rows differ, its scores and its outcome.

    Args:
        rows: of one sweep, in their order; at least one.
    """
    names = row_names(rows)
    metrics = list(dict.fromkeys(metric for row in rows for metric in row.scores))
    counts = [(outcome, sum(row.outcome == outcome for row in rows)) for outcome in ("done", *STYLES)]
    title = ", ".join(f"{count} {outcome}" for outcome, count in counts if count)
    table = Table(title=f"{len(rows)} rows: {title}", title_justify="left")
    table.add_column("row")
    for metric in metrics:
        table.add_column(UNITS.get(metric, metric), justify="right", no_wrap=True)
    table.add_column("outcome")
    for row, name in zip(rows, names, strict=True):
        scores = [number(metric, row.scores[metric]) if metric in row.scores else "" for metric in metrics]
        table.add_row(name, *scores, row.outcome, style=STYLES.get(row.outcome, ""))
    return table
