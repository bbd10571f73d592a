"""Callbacks that Hydra calls before it makes a command's folder: the settings are checked, and the folder is taken."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf, open_dict, read_write

from sci_lightning.cli.composition import from_hydra
from sci_lightning.cli.settings import Place, complete, settings_of
from sci_lightning.configuration.arguments import check_value
from sci_lightning.errors import BadInput
from sci_lightning.runs.resume import check_nothing_lost
from sci_lightning.runs.run_folder import is_first_process, lock, make_folder, unlock


class CommandFailed(BaseException):
    """Ends a command; ``__cause__`` says why.

    It is no ``Exception``: of those Hydra makes a warning when a callback raises one, and writes lines of its own on
    the terminal when a job does.
    """


class CheckBeforeWriting(Callback):
    """Complete and check the configuration when it is composed; Hydra makes the folder ``out`` only afterwards.

    Raises:
        CommandFailed: a setting that is missing, cannot be resolved, or is of another type or out of its range.
    """

    def on_run_start(self, config: DictConfig, config_name: str | None = None, **kwargs: Any) -> None:
        try:
            settings = settings_of(str(config_name))
            if missing := [key for key in settings if OmegaConf.is_missing(config, key)]:
                raise BadInput(f"give {missing[0]}=..; --help says what it is")
            completed = complete(from_hydra(config, config.hydra), str(config_name))
            with read_write(config.hydra.runtime), open_dict(config.hydra.runtime):
                config.hydra.runtime.choices = dict(completed.choices)
        except Exception as error:
            raise CommandFailed from error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        try:  # every other setting may be one of those that the sweep varies; its runs check themselves
            check_value("out", config.get("out"), Place)
        except Exception as error:
            raise CommandFailed from error


class OwnFolder(Callback):
    """Take the folder of a command before Hydra writes into it.

    A name with the time in it is that of a new folder: of commands that start in the same second all but one wait for
    the next. Jobs (``job=``) share the folder of their sweep, which keeps other sweeps out of it.

    Raises:
        CommandFailed: another process writes there, or a training lies there that would be overwritten.
    """

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        if not is_first_process() or config.get("job") is not None:
            return
        try:
            while _is_new(config) and not _made_for(config):
                time.sleep(0.1)
                OmegaConf.clear_cache(config)  # which keeps the time
            with choices_of(config):
                folder = Path(config.hydra.run.dir).resolve()
            lock(folder)
            try:
                check_folder(folder, config)
            except BadInput:
                unlock(folder)
                raise
        except Exception as error:
            raise CommandFailed from error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        if _is_new(config) and not _made_for(config):
            raise CommandFailed from BadInput(f"{config.out}: another sweep was started in this second; start it again")
        if any(word.startswith("job=") for word in config.hydra.overrides.task):
            try:
                lock(Path(config.out).resolve())
            except BadInput as error:
                raise CommandFailed from error

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        unlock(Path(config.out).resolve())


def check_folder(folder: Path, config: DictConfig) -> None:
    """Check that a command with this configuration overwrites no training; raises as ``check_nothing_lost`` does."""
    training = "resume" in config
    settings = {"resume": bool(config.resume), "ckpt_path": config.ckpt_path} if training else {}
    check_nothing_lost(folder, training, **settings)


@contextmanager
def choices_of(config: DictConfig) -> Iterator[None]:
    """Let names in a configuration say what was chosen (``hydra:runtime``), which Hydra knows only once its job runs.

    Hydra's part of ``config`` is read-only afterwards.
    """
    state = HydraConfig.instance()
    present = state.cfg
    state.set_config(config)
    try:
        yield
    finally:
        state.cfg = present


def _is_new(config: DictConfig) -> bool:
    """Return whether a command's folder is called after the time."""
    content = OmegaConf.to_container(config, resolve=False)
    return isinstance(content, dict) and "${now:" in str(content["out"])


def _made_for(config: DictConfig) -> bool:
    """Make a command's folder; return False if it is there."""
    try:
        make_folder(Path(config.out).resolve())
    except FileExistsError:
        return False
    return True
