"""The rows of a sweep: what became of each, in whichever process or on whichever machine it ran."""

from __future__ import annotations

import copy
import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, flag_override, open_dict, read_write
from omegaconf.errors import ConfigAttributeError, ConfigKeyError

from sci_lightning.cli.failure_line import one_line
from sci_lightning.errors import BadInput, NoSuchCombination
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.runs.run_folder import check_folder, is_first_process

CHANGES_EVERYTHING = ("experiment", "scale")
"""Groups whose members set values anywhere in the configuration."""

PLACES = {"effect": "encoder", "metric": "metrics"}
"""Where the members of a group are set, if not under the group's own name."""


@dataclass(frozen=True)
class Row:
    """What became of one run of a sweep.

    Attributes:
        number: its place in the sweep, from 0.
        overrides: of the command line, the swept values among them.
        outcome: ``done``, ``skipped`` (the combination does not exist), ``failed``, or ``unfinished`` (it was
            interrupted or killed, or never began).
        line: for rows that are not done, what is wrong and what would be right.
        status: the exit status that it calls for, 0 if it is done or skipped.
        scores: means over the scenes, by metric, of commands that leave a ``metrics.json``.
    """

    number: int
    overrides: list[str]
    outcome: str = "unfinished"
    line: str = "interrupted or killed before its end"
    status: int = 1
    scores: Mapping[str, float] = field(default_factory=dict)


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

    def write(self, row: Row) -> None:
        with whole_file(self.folder / f"{row.number}.json") as temporary:
            temporary.write_text(json.dumps(asdict(row)))

    def take(self) -> list[Row]:
        """Read all rows, in their order, and remove the files."""
        files = sorted(self.folder.glob("[0-9]*.json"), key=lambda path: int(path.stem))
        rows = [Row(**json.loads(path.read_text())) for path in files]
        shutil.rmtree(self.folder, ignore_errors=True)
        return rows


def present_row() -> tuple[RowFiles, int, list[str]] | None:
    """Return where the running row leaves its outcome, its number and its overrides; None outside a sweep."""
    hydra = HydraConfig.get() if HydraConfig.initialized() else None
    if hydra is None or hydra.mode is not RunMode.MULTIRUN or OmegaConf.is_missing(hydra.job, "num"):
        return None
    return RowFiles(_settings()["folder"]), int(hydra.job.num), list(hydra.overrides.task)


def refuse_uncomposed_row() -> None:
    """Raise what was wrong with the configuration of the row that is running now, if it could not be composed.

    Raises:
        BadInput: NoSuchCombination where the row is to be skipped.
    """
    error = _settings().get("error") if present_row() else None
    if error is not None:
        raise (NoSuchCombination if error["skipped"] else BadInput)(error["line"])


def scores_in(folder: Path) -> dict[str, float]:
    """The mean scores of the ``metrics.json`` in a folder, empty if there is none."""
    path = folder / "metrics.json"
    return dict(json.loads(path.read_text())["mean"]) if path.is_file() else {}


def finished_rows() -> list[Row]:
    """All rows of the sweep that this process started, in their order; empty if it started none."""
    folder = _settings().get("folder") if HydraConfig.initialized() else None
    return [] if folder is None else RowFiles(folder).take()


def _settings() -> Any:
    """The settings of :class:`SweepStart` in the configuration of the present run."""
    return HydraConfig.get().callbacks.get("sweep", {})


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


class RowLoader(ConfigLoaderImpl):
    """Composes the rows of a sweep; one that cannot be composed becomes a row that fails, and the others go on.

    Hydra and its launchers let an error in composing end the whole sweep.
    """

    def __init__(self, config_search_path: ConfigSearchPath) -> None:
        super().__init__(config_search_path)
        self.process = os.getpid()
        self.planned: list[list[str]] = []

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        folder = master_config.hydra.callbacks.sweep.folder
        if os.getpid() == self.process and list(sweep_overrides) not in self.planned:
            RowFiles(folder).write(Row(len(self.planned), list(sweep_overrides)))
            self.planned.append(list(sweep_overrides))
        try:
            row = super().load_sweep_config(master_config, sweep_overrides)
            if is_first_process() and list(sweep_overrides) in self.planned:
                check_folder(_folder(row, self.planned.index(list(sweep_overrides))), row)
        except Exception as error:
            row = _uncomposed(master_config, sweep_overrides, error)
        with flag_override(row.hydra, "struct", False):
            row.hydra.callbacks.sweep.folder = folder
        return row


def _folder(row: DictConfig, number: int) -> Path:
    """Where a row will write, which may depend on its number."""
    present, row_then = HydraConfig.instance().cfg, copy.deepcopy(row)  # what is set in Hydra's state is made read-only
    OmegaConf.copy_cache(from_config=row, to_config=row_then)
    with read_write(row_then.hydra.job), open_dict(row_then.hydra.job):
        row_then.hydra.job.num = number
    try:
        HydraConfig.instance().set_config(row_then)
        return Path(row_then.hydra.sweep.dir, row_then.hydra.sweep.subdir).resolve()
    finally:
        HydraConfig.instance().cfg = present


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


class SweepStart(Callback):
    """Prepares a sweep: a folder for the outcomes of its rows, and a loader that no row's configuration can stop.

    The configuration is kept in Hydra's state, where the process that started the sweep finds that folder at the end.

    Args:
        folder: where rows leave their outcomes; set by this callback.
        error: why a row has no configuration; set by :class:`RowLoader`.
    """

    def __init__(self, folder: str | None = None, error: Mapping[str, Any] | None = None) -> None:
        self.folder, self.error = folder, error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        config.hydra.callbacks.sweep.folder = str(Path(config.hydra.sweep.dir).absolute() / f".rows_{uuid4().hex}")
        HydraConfig.instance().set_config(config)
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None
        hydra.config_loader = RowLoader(hydra.config_loader.get_search_path())
