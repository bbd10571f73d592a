"""The end of a sweep on the terminal: a table of its rows, what was skipped or failed, and what to run next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from rich.table import Table

from sci_lightning.cli.next_command import dashboard, invocation, print_next
from sci_lightning.cli.sweep import RowOutcome
from sci_lightning.console import PlainConsole
from sci_lightning.runs.results import UNITS, number

STYLES = {"skipped": "dim", "failed": "red", "unfinished": "red"}


def print_summary(rows: Sequence[RowOutcome], interrupted: bool = False) -> None:
    """Print the table of a sweep's rows and a line for each that was skipped.

    What to run next follows if any row was scored, unless the sweep was ``interrupted``.
    """
    console = PlainConsole()
    console.print(sweep_table(rows))
    for row, name in zip(rows, row_names(rows), strict=True):
        if row.outcome == "skipped":
            console.print(f"skipped: [{name}] {row.line}")
    if not interrupted and any(row.scores for row in rows):
        folder = Path(HydraConfig.get().sweep.dir)
        dashboards = any(folder.glob("**/tensorboard"))
        lines = [dashboard(folder)] if dashboards else []
        print_next(console, invocation("tables", paths={"runs": folder}), *lines)


def failures(rows: Sequence[RowOutcome]) -> list[tuple[str, int]]:
    """Return a line and an exit status for each row that failed, and for a sweep of which no row ran to its end."""
    failed = [(f"[{' '.join(row.overrides)}] {row.line}", row.status) for row in rows if row.outcome == "failed"]
    if unfinished := sum(row.outcome == "unfinished" for row in rows):
        failed.append((f"{unfinished} of {len(rows)} rows did not run to their end", 1))
    if not failed and rows and all(row.outcome == "skipped" for row in rows):
        return [(f"none of the {len(rows)} rows exists: {rows[0].line}", 2)]
    return failed


def row_names(rows: Sequence[RowOutcome]) -> list[str]:
    """Return the overrides in which each row differs from the others; all of them for a single row."""
    common = set(rows[0].overrides).intersection(*(row.overrides for row in rows)) if len(rows) > 1 else set()
    return [" ".join(override for override in row.overrides if override not in common) for row in rows]


def sweep_table(rows: Sequence[RowOutcome]) -> Table:
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
    where = ["host", "id", "restarts"] if any(row.job for row in rows) else []
    for heading in where:
        table.add_column("job" if heading == "id" else heading)
    for row, name in zip(rows, names, strict=True):
        scores = [number(metric, row.scores[metric]) if metric in row.scores else "" for metric in metrics]
        job = [str(row.job.get(key, "")) for key in where]
        table.add_row(name, *scores, row.outcome, *job, style=STYLES.get(row.outcome, ""))
    return table
