"""``python -m sci_lightning.tables.rows``: train every row of the paper's tables, and keep the results of each."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import DocInfo
from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition, compose, plain
from sci_lightning.cli.settings import CommandSettings, FolderName, Name, Place
from sci_lightning.configuration.bounds import Positive, Repeats
from sci_lightning.console import PlainConsole
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.runs.run_folder import undo_if_refused

if TYPE_CHECKING:
    from sci_lightning.studies.tables.rows import TableRow


@dataclass(frozen=True)
class TablesRowsSettings(CommandSettings):
    row_scale: Name
    core_minutes: Positive | None
    steps: Repeats | None
    seeds: Repeats
    other_seeds: Repeats
    only: Sequence[Name] | None
    threads: Repeats
    overrides: Annotated[str, DocInfo("overrides of every training, as one text")] | None
    label: FolderName | None
    results: Place
    dry_run: bool
    devices: Name


def tables_rows(composition: Composition) -> None:
    """Train the rows that are not kept yet, where Hydra's launcher runs them; each is kept as it ends.

    With ``dry_run=true`` it only says what all rows would take on ``devices``.

    Raises:
        BadInput: settings of no use; a kept row that was trained otherwise.
        MachineFailure: rows failed; the others were trained.
    """
    from sci_lightning.cli.commands.tables import tables
    from sci_lightning.cli.launched_rows import launch_rows, launcher_words
    from sci_lightning.cli.next_command import override, print_next
    from sci_lightning.studies.tables.paper_figures import paper_figures
    from sci_lightning.studies.tables.rows import check_recipe, is_kept, plan

    cfg, console, out = composition.cfg, PlainConsole(), Path(composition.cfg.out).resolve()
    budget = _budget(composition)
    label = budget.label
    results = (Path(cfg.results) / label).resolve()
    more = [f"scale={cfg.row_scale}", *budget.overrides]
    try:
        more += shlex.split(cfg.overrides or "")
    except ValueError as error:
        raise BadInput(f"overrides={cfg.overrides}: {str(error).lower()}; give words as on a command line") from error
    rows = plan(paper_figures()["tables"], cfg.seeds, cfg.only or (), cfg.other_seeds)
    if not rows:
        raise BadInput(f"only={list(cfg.only)}: no row is called so; name tables (table5) or parts of rows (e2e_cnn)")
    if cfg.dry_run:
        _print_cost(rows, more, cfg.devices)
        undo_if_refused(out, "tables_rows")  # the folder that Hydra has made
        return
    kept = [row for row in rows if is_kept(row, results)]
    recipes: dict[str, dict[str, Any]] = {}
    for row in kept or rows[:1]:  # the first one shows whether the overrides are of any use
        if row.name not in recipes:  # whatever the seed
            recipes[row.name] = plain(compose("train", [*row.overrides(), *more]).cfg)
        if kept:
            check_recipe(row, results, recipes[row.name])
    done = set(kept)
    waiting = [row for row in rows if row not in done]
    hours = f", about {len(waiting) * budget.minutes / 60:.1f} core hours" if budget.minutes else ""
    console.print(f"{len(waiting)} of {len(rows)} rows left{hours}; results in {results}", soft_wrap=True)
    words = shlex.join(f"{key}={cfg[key]}" for key in ("row_scale", "core_minutes", "steps", "label") if cfg[key])
    row_task = KeptTraining(waiting, results, budget.scale, f"python -m sci_lightning.tables.rows {words}", cfg.threads)
    folder = override("out", str(out / label))
    overrides = [[*row.overrides(), *more, "resume=true", folder] for row in waiting]
    outcomes = launch_rows("train", row_task, overrides, folder, launcher_words()) if waiting else []
    if any(is_kept(row, results) for row in rows):
        where = [override("runs", str(results)), override("out", str(out / label / "tables")), "mosaic=0"]
        tables(compose("tables", where))
    if failed := [(waiting[one.number], one.line) for one in outcomes if one.outcome != "done"]:
        names = ", ".join(f"{row.name} seed {row.seed}" for row, _ in failed)
        row, reason = failed[0]
        raise MachineFailure(f"{len(failed)} of {len(rows)} rows failed ({names}); {row.name}: {reason}")
    print_next(console, "make documentation")


def _print_cost(rows: list[TableRow], more: Sequence[str], devices: str) -> None:
    """Print the steps, examples, hours and memory of rows that are trained with further overrides."""
    from sci_lightning.studies.tables.plan_cost import cost_table

    def config_of(row: TableRow) -> dict[str, Any]:
        content = OmegaConf.to_container(compose("train", [*row.overrides(), *more]).cfg, resolve=True)
        assert isinstance(content, dict)  # data.root may be missing in it
        return {str(key): value for key, value in content.items()}

    console = PlainConsole()
    console.print(cost_table(rows, config_of, devices).as_table(console.width))


@dataclass(frozen=True)
class KeptTraining:
    """Trains a row of the tables, in whatever process, and keeps its metrics as it ends.

    Attributes:
        rows: in the order in which they were handed to the launcher.
        results: folder of all rows' results.
        scale, command: for the provenance.
        threads: of each training.
    """

    rows: list[TableRow]
    results: Path
    scale: str
    command: str
    threads: int

    def __call__(self, composition: Composition) -> float | None:
        import torch
        from hydra.core.hydra_config import HydraConfig

        from sci_lightning.cli.commands.train import train
        from sci_lightning.runs.provenance import provenance_now
        from sci_lightning.runs.run_folder import is_first_process
        from sci_lightning.studies.tables.rows import keep

        torch.set_num_threads(self.threads)
        psnr, row, run = train(composition), self.rows[int(HydraConfig.get().job.num)], Path(composition.cfg.out)
        if is_first_process():
            origin = provenance_now(_trained_on(run), self.scale, [row.seed], self.command)
            (path, *_) = keep(row, run, self.results, origin)
            PlainConsole().print(f"{datetime.now():%H:%M:%S} kept {path}", soft_wrap=True)
        return psnr


@dataclass(frozen=True)
class _Budget:
    """How long a row is trained.

    Attributes:
        minutes: of one core; 0: no limit.
        overrides: of every training.
        scale: what the results say about it.
        label: the folder of the results: the scale, and what differs from it.
    """

    minutes: float
    overrides: tuple[str, ...]
    scale: str
    label: str


def _budget(composition: Composition) -> _Budget:
    """Return the budget of a row: steps where they are given, else the core minutes.

    Raises:
        BadInput: both are given.
    """
    cfg = composition.cfg
    end = [cfg.label] if cfg.label else []
    if cfg.steps is not None:
        if cfg.core_minutes is not None:
            raise BadInput(f"steps={cfg.steps} core_minutes={cfg.core_minutes}: give one of them; both end a training")
        overrides = ("core_minutes=null", f"trainer.max_steps={cfg.steps}")
        label = "_".join([cfg.row_scale, f"{cfg.steps}_steps", *end])
        return _Budget(0.0, overrides, f"{cfg.row_scale}, {cfg.steps} steps", label)
    usual = compose("train", [f"scale={cfg.row_scale}"]).cfg.core_minutes
    given = cfg.core_minutes is not None
    minutes = float((cfg.core_minutes if given else usual) or 0)
    parts = [cfg.row_scale, *([] if minutes == float(usual or 0) else [f"{minutes:g}_minutes"]), *end]
    scale = f"{cfg.row_scale}, {minutes:g} core minutes" if minutes else cfg.row_scale
    return _Budget(minutes, (f"core_minutes={cfg.core_minutes}",) if given else (), scale, "_".join(parts))


def _trained_on(run: Path) -> str:
    """Return the name of what trained a row: the GPU that its metrics name, else a core of this machine."""
    from sci_lightning.runs.device import is_processor
    from sci_lightning.runs.provenance import machine_name

    device = str(json.loads((run / "metrics.json").read_text())["device"])
    return machine_name(1) if is_processor(device) else device
