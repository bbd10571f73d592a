"""The rows of a sweep: what became of each, in whichever process or on whichever machine it ran."""

from __future__ import annotations

import copy
import io
import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any
from uuid import uuid4

from hydra.conf import HydraConf
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf, flag_override, open_dict, read_write
from omegaconf.errors import ConfigAttributeError, ConfigKeyError

from sci_lightning.cli.composition import is_row
from sci_lightning.cli.failure_line import exit_status, one_line, root_cause
from sci_lightning.cli.hydra_callbacks import check_folder, choices_of
from sci_lightning.errors import BadInput, NoSuchCombination
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.cluster_job import ROW_RESTARTS, job_of_this_process
from sci_lightning.runs.run_folder import is_first_process, make_folder

CHANGES_EVERYTHING = ("experiment", "scale")
"""Groups whose members set values anywhere in the configuration."""

PLACES = {"effect": "encoder", "metric": "metrics"}
"""Where the members of a group are set, if not under the group's own name."""

VALIDATING_SWEEPER = "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"
"""Hydra's own, which composes every row once before the launcher does. Here a row that cannot be composed ends where it
runs, and hundreds of rows would wait a quarter of a second each before the first one begins."""


@dataclass(frozen=True)
class RowOutcome:
    """What became of one run of a sweep.

    Attributes:
        number: its place in the sweep, from 0.
        overrides: of the command line, the swept values among them.
        outcome: ``done``, ``skipped`` (the combination does not exist), ``failed``, or ``unfinished`` (it was
            interrupted or killed, or never began).
        line: for rows that are not done, what is wrong and what would be right.
        status: the exit status that it calls for, 0 if it is done or skipped.
        scores: means over the scenes, by metric, of commands that leave a ``metrics.json``.
        job: of the cluster that ran it last: ``host``, ``id`` and ``restarts``; empty on this machine.
    """

    number: int
    overrides: list[str]
    outcome: str = "unfinished"
    line: str = "interrupted or killed before its end"
    status: int = 1
    scores: Mapping[str, float] = field(default_factory=dict)
    job: Mapping[str, Any] = field(default_factory=dict)


def is_skipped(error: BaseException) -> bool:
    """Whether an error says that a combination does not exist, such as a binary mask of four bits.

    A setting that the row's choices do not know, such as ``decoder.blocks`` where ``decoder`` has none, counts as well.
    """
    if isinstance(error, HydraException):
        return isinstance(error.__cause__, (ConfigAttributeError, ConfigKeyError))
    return isinstance(error, NoSuchCombination)


class RowFiles:
    """One JSON file for each row, in the sweep's folder, which every process of every launcher sees."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def write(self, row: RowOutcome) -> None:
        write_json(asdict(row), self._path(row.overrides), among_many=True)

    def read(self, overrides: Sequence[str]) -> RowOutcome | None:
        """Return what is known of the row with these overrides, None if it is not planned."""
        path = self._path(overrides)
        return RowOutcome(**json.loads(path.read_text())) if path.is_file() else None

    def take(self) -> list[RowOutcome]:
        """Read all rows, in their order, and remove the files."""
        rows = [RowOutcome(**json.loads(path.read_text())) for path in self.folder.glob("*.json")]
        shutil.rmtree(self.folder, ignore_errors=True)
        return sorted(rows, key=lambda row: row.number)

    def _path(self, overrides: Sequence[str]) -> Path:
        return self.folder / f"{sha256(json.dumps(list(overrides)).encode()).hexdigest()[:20]}.json"


def refuse_uncomposed_row(settings: HydraConf) -> None:
    """Raise what was wrong with the configuration of a row that could not be composed; nothing happens to others.

    Args:
        settings: Hydra's own, of the job that is running.

    Raises:
        BadInput: NoSuchCombination where the row is to be skipped.
    """
    error = settings.callbacks["sweep"]["error"] if is_row(settings) else None
    if error is not None:
        raise (NoSuchCombination if error["skipped"] else BadInput)(error["line"])


def mean_scores(folder: Path) -> dict[str, float]:
    """Return the mean scores of the ``metrics.json`` in a folder by metric, empty if there is none."""
    path = folder / "metrics.json"
    return dict(json.loads(path.read_text())["mean"]) if path.is_file() else {}


def finished_rows() -> list[RowOutcome]:
    """Return all rows of the sweep that this process started, in their order; empty if it started none."""
    folder = HydraConfig.get().callbacks.get("sweep", {}).get("folder") if HydraConfig.initialized() else None
    return [] if folder is None else RowFiles(folder).take()


def defer_to_rows(arguments: Sequence[str]) -> list[str]:
    """Make settings below a swept group part of the rows: ``decoder.blocks=2`` becomes ``decoder.blocks=choice(2)``.

    Hydra composes a sweep's configuration once without any swept value. A setting that the default member of the group
    does not know would end the sweep there, though the rows know it.

    Args:
        arguments: of the command line; unchanged unless they ask for a sweep.
    """
    if not {"-m", "--multirun"} & set(arguments):
        return list(arguments)
    parser = OverridesParser.create()
    swept: set[str] = set()
    single: dict[int, str] = {}
    for place, argument in enumerate(arguments):
        key, equals, value = argument.partition("=")
        if argument.startswith("-") or not equals or not value:
            continue
        try:
            override = parser.parse_override(argument)
        except HydraException:
            continue  # refused by Hydra itself in a moment, with its own words
        name = override.key_or_group
        if override.is_sweep_override():
            if "." not in name:
                group = name.partition("/")[0]
                swept.add(PLACES.get(group, group))
        elif "." in name and not override.is_delete() and not name.startswith("hydra."):
            single[place] = f"{key}=choice({value})"
    changed = list(arguments)
    for place, argument in single.items():
        top = argument.lstrip("+").partition(".")[0]
        if top in swept or swept.intersection(CHANGES_EVERYTHING):
            changed[place] = argument
    return changed


class RowLoader:
    """Composes the rows of a sweep; one that cannot be composed becomes a row that fails, and the others go on.

    Hydra and its launchers let an error in composing end the whole sweep. Everything but the rows is left to Hydra's
    own loader.

    Args:
        loader: Hydra's own.
        rows: where the outcome of each row is written; every row is "unfinished" as soon as it is planned.
    """

    def __init__(self, loader: ConfigLoader, rows: RowFiles) -> None:
        self.loader, self.rows = loader, rows
        self.process = os.getpid()
        self.planned = 0

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        overrides = list(sweep_overrides)
        planned = self.rows.read(overrides)
        if planned is None and os.getpid() == self.process:
            planned, self.planned = RowOutcome(self.planned, overrides), self.planned + 1
            self.rows.write(planned)
            if master_config.hydra.sweeper._target_ == VALIDATING_SWEEPER:
                return master_config
        try:
            row = self.loader.load_sweep_config(master_config, sweep_overrides)
            if is_first_process() and planned is not None:
                folder = _folder(row, planned.number)
                check_folder(folder, row)
                make_folder(folder, exist_ok=True)  # Hydra would make it where nobody learns why it cannot be made
        except Exception as error:
            row = _uncomposed(master_config, sweep_overrides, error)
        return row

    def __getattr__(self, name: str) -> Any:
        if name == "loader":  # while it is unpickled in another process
            raise AttributeError(name)
        return getattr(self.loader, name)


def _folder(row: DictConfig, number: int) -> Path:
    """Where a row will write, which may depend on its number."""
    row_then = copy.deepcopy(row)  # what is set in Hydra's state is made read-only
    OmegaConf.copy_cache(from_config=row, to_config=row_then)
    with read_write(row_then.hydra.job), open_dict(row_then.hydra.job):
        row_then.hydra.job.num = number
    with choices_of(row_then):
        return Path(row_then.hydra.sweep.dir, row_then.hydra.sweep.subdir).resolve()


def _uncomposed(master: DictConfig, overrides: list[str], error: Exception) -> DictConfig:
    """The configuration of a row that only says why it has none, and leaves nothing on the disk."""
    row = copy.deepcopy(master)
    OmegaConf.copy_cache(from_config=master, to_config=row)
    OmegaConf.set_readonly(row.hydra, False)
    with flag_override(row.hydra, "struct", False):
        row.hydra.overrides.task = list(overrides)
        row.hydra.output_subdir = None
        row.hydra.sweep.subdir = "."
        row.hydra.job_logging = row.hydra.hydra_logging
        unknown = re.match(r"Could not override '(.+?)'", str(error)) if is_skipped(error) else None
        line = f"{unknown[1]} is no setting of what this row chooses" if unknown else one_line(error)
        row.hydra.callbacks.sweep.error = {"line": line, "skipped": is_skipped(error)}
    return row


class SweepRows(Callback):
    """Collects the rows of a sweep: a failure ends its row, never the sweep, whichever launcher and sweeper run it.

    A row may run in another process or on another machine (joblib, submitit), where Hydra calls ``on_job_end``, and it
    may be killed there. What became of it therefore goes through a file in the sweep's folder, which all of them see.

    Args:
        folder: where rows leave their outcomes; set when a sweep starts, and kept in Hydra's state, where the process
            that started the sweep finds it at the end.
        error: why a row has no configuration; set by :class:`RowLoader`.
    """

    def __init__(self, folder: str | None = None, error: Mapping[str, Any] | None = None) -> None:
        self.folder, self.error = folder, error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        self.folder = str(Path(config.hydra.sweep.dir).absolute() / f".rows_{uuid4().hex}")
        config.hydra.callbacks.sweep.folder = self.folder
        HydraConfig.instance().set_config(config)
        hydra = GlobalHydra.instance().hydra
        if hydra is not None:
            loader: Any = RowLoader(hydra.config_loader, RowFiles(self.folder))
            hydra.config_loader = loader

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        HydraConfig.instance().set_config(config)  # joblib with one process leaves that of its last row there

    def on_job_start(self, config: DictConfig, **kwargs: Any) -> None:
        if self.folder is None or not is_row(config.hydra) or not _job() or not is_first_process():
            return
        rows, place = RowFiles(self.folder), _place(config)
        earlier = rows.read(place[1])
        os.environ[ROW_RESTARTS] = str(earlier.job["restarts"] + 1 if earlier is not None and earlier.job else 0)
        rows.write(RowOutcome(*place, job=_job()))

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        if self.folder is None or not is_row(config.hydra):
            return
        place = _place(config)
        try:
            with redirect_stderr(io.StringIO()):  # asked for its result, a failed job writes on the terminal
                _ = job_return.return_value
        except Exception as error:
            outcome = "skipped" if is_skipped(root_cause(error)) else "failed"
            row = RowOutcome(*place, outcome, one_line(error), exit_status(error), job=_job())
            job_return.return_value, job_return.status = None, JobStatus.COMPLETED
        else:
            scores = mean_scores(Path(config.hydra.runtime.output_dir))
            row = RowOutcome(*place, "done", "", 0, scores, _job())
        RowFiles(self.folder).write(row)


def _place(config: DictConfig) -> tuple[int, list[str]]:
    """Return the number of a row and its overrides as they were written."""
    overrides = OmegaConf.to_container(config.hydra.overrides.task, resolve=False)
    if not isinstance(overrides, list):
        raise TypeError("expected a list")
    return int(config.hydra.job.num), overrides


def _job() -> dict[str, Any]:
    job = job_of_this_process()
    return {} if job is None else job.as_json()
