"""A training that is killed at a stated step, once, and the steps that it made."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L

KILLED = "+callbacks.steps={_target_: tests.end_to_end.killed_training.Steps, kill_at: {%s}}"


class Steps(L.Callback):
    """Notes every step in a file, and kills the run and all its processes once, at a stated step.

    Args:
        kill_at: the step at which the training of each decoder waits; when all of them have come there, the processes
            are killed. A folder with a file ``killed_once`` has seen this before: the run goes through.
    """

    def __init__(self, kill_at: Mapping[str, int]) -> None:
        self.kill_at = kill_at

    def on_train_batch_start(self, trainer: L.Trainer, *_: Any) -> None:
        decoder = type(trainer.lightning_module.decoder).__name__
        with Path("steps.txt").open("a") as file:
            file.write(f"{decoder} {trainer.global_step}\n")
        if self.kill_at.get(decoder) != trainer.global_step or Path("killed_once").exists():
            return
        while not all(step in steps(Path(), name) for name, step in self.kill_at.items()):
            time.sleep(0.01)
        if decoder != next(iter(self.kill_at)):
            signal.pause()
        Path("killed_once").touch()
        os.killpg(0, signal.SIGKILL)


def steps(folder: Path, decoder: str) -> list[int]:
    lines = [line.split() for line in (folder / "steps.txt").read_text().splitlines()]
    return [int(step) for name, step in lines if name == decoder]
