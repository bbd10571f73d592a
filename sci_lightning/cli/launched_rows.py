"""Runs of a command from lists of overrides, in whatever place one of Hydra's launchers has for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.types import HydraContext, RunMode
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.cli.command import Task, job_of
from sci_lightning.cli.composition import hydra_of
from sci_lightning.cli.sweep import RowFiles, RowOutcome, finished_rows


class RowCallbacks:
    """Calls the callbacks of a configuration, as launchers expect it of Hydra's own class, which is private."""

    def __init__(self, config: DictConfig) -> None:
        self.callbacks = [instantiate(one) for one in config.hydra.callbacks.values()]

    def __getattr__(self, name: str) -> Callable[..., None]:
        if not name.startswith("on_"):
            raise AttributeError(name)
        return partial(self._call, name)

    def _call(self, name: str, **arguments: Any) -> None:
        for callback in self.callbacks:
            getattr(callback, name)(**arguments)


def launcher_words() -> list[str]:
    """Return the overrides of the command that is running which choose and set Hydra's launcher."""
    words = [str(word) for word in HydraConfig.get().overrides.hydra]
    return [word for word in words if word.lstrip("+").startswith(("hydra/launcher", "hydra.launcher"))]


def launch_rows(
    command: str, task: Task, rows: Sequence[Sequence[str]], out: str, launcher: Sequence[str]
) -> list[RowOutcome]:
    """Run a task with the configuration of a command, once for every list of overrides.

    It is a sweep whose rows need not be the product of a few choices: a row that fails stops no other.

    Args:
        command: the name of its file in ``conf/``.
        task: that is run; it travels to other processes.
        rows: the overrides of each run, all of them.
        out: override of the folder that all of them share.
        launcher: overrides that choose and set Hydra's launcher; none for one run after the other in this process.

    Returns:
        what became of each, in their order.
    """
    present = HydraConfig.instance().cfg  # of the command that is running
    try:
        with hydra_of(command) as hydra:
            words = ["hydra.mode=MULTIRUN", *launcher, out]
            master = hydra.compose_config(command, words, RunMode.MULTIRUN)
            callbacks: Any = RowCallbacks(master)
            callbacks.on_multirun_start(config=master, config_name=command)
            try:
                context = HydraContext(config_loader=hydra.config_loader, callbacks=callbacks)
                plugin = Plugins.instance().instantiate_launcher(context, job_of(command, task), master)
                files = RowFiles(str(master.hydra.callbacks.sweep.folder))
                for number, row in enumerate(rows):  # a row that no process ever begins is unfinished
                    files.write(RowOutcome(number, list(row)))
                plugin.launch([list(row) for row in rows], initial_job_idx=0)
            finally:
                callbacks.on_multirun_end(config=master, config_name=command)
                outcomes = finished_rows()
            return outcomes
    finally:
        HydraConfig.instance().cfg = present
