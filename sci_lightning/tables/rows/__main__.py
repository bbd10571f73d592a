"""``python -m sci_lightning.tables.rows``: train every row of the paper's tables, and keep the results of each."""

from __future__ import annotations

import os
import shlex
import sys
from datetime import datetime
from pathlib import Path

import yaml

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, compose, plain
from sci_lightning.cli.console import PlainConsole
from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.errors import BadInput, MachineFailure


def tables_rows(composition: Composition) -> None:
    """Train the rows that are not kept yet, a few at a time, and write what each found as it ends.

    Args:
        composition: of ``conf/tables_rows.yaml``.

    Raises:
        BadInput: settings of no use; a kept row that was trained otherwise.
        MachineFailure: rows failed; the others were trained.
    """
    from sci_lightning.cli.next_command import override, print_next
    from sci_lightning.tables.__main__ import tables
    from sci_lightning.tables.provenance import machine_name, provenance_now
    from sci_lightning.tables.rows.kept import check_recipe, is_kept, keep
    from sci_lightning.tables.rows.plan import TableRow, plan
    from sci_lightning.tables.rows.queue import RowQueue

    cfg, console, out = composition.cfg, PlainConsole(), Path(composition.cfg.out).resolve()
    minutes, label = _budget(composition)
    results = Path(cfg.results) / label
    more = [f"scale={cfg.row_scale}", *([] if cfg.core_minutes is None else [f"core_minutes={cfg.core_minutes}"])]
    try:
        more += shlex.split(cfg.overrides or "")
    except ValueError as error:
        raise BadInput(f"overrides={cfg.overrides}: {str(error).lower()}; give words as on a command line") from error
    paper = yaml.safe_load((PACKAGE / "tables" / "paper_figures.yaml").read_text())["tables"]
    rows = plan(paper, cfg.seeds, cfg.only or (), cfg.other_seeds)
    if not rows:
        raise BadInput(f"only={list(cfg.only)}: no row is called so; name tables (table5) or parts of rows (e2e_cnn)")
    for row in rows:
        if row is rows[0] or is_kept(row, results):  # the first one shows whether the overrides are of any use
            config = plain(compose("train", [*row.overrides(), *more]).cfg)
            if is_kept(row, results):
                check_recipe(row, results, config)
    waiting = [row for row in rows if not is_kept(row, results)]

    def say(line: str) -> None:
        left = sum(not is_kept(row, results) for row in rows)
        hours = f", about {left * minutes / 60:.1f} core hours" if minutes else ""
        console.print(f"{datetime.now():%H:%M:%S} {line}; {left} of {len(rows)} rows left{hours}", soft_wrap=True)
        sys.stdout.flush()

    def finished(row: TableRow) -> None:
        scale = f"{cfg.row_scale}, {minutes:g} core minutes" if minutes else cfg.row_scale
        words = shlex.join(f"{key}={cfg[key]}" for key in ("row_scale", "core_minutes", "label") if cfg[key])
        origin = provenance_now(machine_name(1), scale, [row.seed], f"python -m sci_lightning.tables.rows {words}")
        (path, *_) = keep(row, out / label / row.folder, results, origin)
        say(f"kept {path}")

    def command(row: TableRow) -> list[str]:
        places = [override(key, str(out / label / row.folder)) for key in ("out", "hydra.run.dir")]
        return ["-m", "sci_lightning.train", *row.overrides(), *more, "resume=true", *places]

    workers = min(cfg.workers or os.cpu_count() or 1, max(1, len(waiting)))
    say(f"{workers} rows at a time, one thread each, results in {results}")
    queue = RowQueue(waiting, out / label, command, finished, say, workers)
    queue.run()
    if any(is_kept(row, results) for row in rows):
        where = [override("runs", str(results)), override("out", str(out / label / "tables")), "mosaic=0"]
        tables(compose("tables", where))
    if queue.failed:
        row, reason = next(iter(queue.failed.items()))
        names = ", ".join(f"{row.name} seed {row.seed}" for row in queue.failed)
        raise MachineFailure(f"{len(queue.failed)} of {len(rows)} rows failed ({names}); {row.name}: {reason}")
    print_next(console, "make documentation")


def _budget(composition: Composition) -> tuple[float, str]:
    """Return the core minutes of a row (0: no limit), and the folder of the results: the scale, and what differs."""
    cfg = composition.cfg
    usual = compose("train", [f"scale={cfg.row_scale}"]).cfg.core_minutes
    minutes = usual if cfg.core_minutes is None else cfg.core_minutes
    parts = [
        cfg.row_scale,
        *([] if minutes == usual else [f"{minutes:g}_minutes"]),
        *([cfg.label] if cfg.label else []),
    ]
    return float(minutes or 0), "_".join(parts)


if __name__ == "__main__":
    run("tables_rows", tables_rows)
