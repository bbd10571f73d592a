"""What went wrong in the runs of one command, in whichever processes or on whichever machines they ran."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from sci_lightning.atomic_file import whole_file


@dataclass(frozen=True)
class Failure:
    """One run that failed.

    Attributes:
        line: what is wrong and what would be right.
        status: exit status that it calls for.
        overrides: which run of a sweep it is; empty if there is but one.
    """

    line: str
    status: int
    overrides: str = ""

    def __str__(self) -> str:
        return f"[{self.overrides}] {self.line}" if self.overrides else self.line


class Failures:
    """All that failed since the command was started.

    A run of a sweep leaves its failure as a file in the sweep's folder, which every process of every launcher sees;
    the file's name is the number of the run.
    """

    def __init__(self) -> None:
        self.folder = f".failures_{uuid4().hex}"
        self.here: list[Failure] = []

    def add(self, line: str, status: int) -> None:
        """Note that the present run failed, or the command itself if no run is going on."""
        hydra = HydraConfig.get() if HydraConfig.initialized() else None
        if hydra is None or hydra.mode is not RunMode.MULTIRUN or OmegaConf.is_missing(hydra.job, "num"):
            self.here.append(Failure(line, status))
            return
        failure = Failure(line, status, " ".join(hydra.overrides.task))
        with whole_file(Path(hydra.sweep.dir) / self.folder / f"{hydra.job.num}.json") as temporary:
            temporary.write_text(json.dumps(asdict(failure)))

    def all(self) -> list[Failure]:
        """Every failure, in the order of the runs; what lay in files is removed."""
        if not HydraConfig.initialized():
            return self.here
        folder = Path(HydraConfig.get().sweep.dir) / self.folder
        files = sorted(folder.glob("*.json"), key=lambda path: int(path.stem))
        found = [Failure(**json.loads(path.read_text())) for path in files]
        shutil.rmtree(folder, ignore_errors=True)
        return found + self.here


class ToldInMainProcess(Callback):
    """Keeps a sweep's configuration in Hydra's state, where the process that started the sweep finds its folder."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        _ = config.hydra.sweep.dir  # the time in its name is kept with the configuration once it has been asked for
        HydraConfig.instance().set_config(config)
