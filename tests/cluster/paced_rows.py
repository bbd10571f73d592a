"""Rows of a sweep that take as long as they should, note every step, and can be compared with uninterrupted ones."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import lightning as L
import torch

SWEEP = [
    *("-m", "experiment=sweep", "scale=smoke", "decoder=e2e_cnn", "encoder=rbw_osr", "data.scenes_count=1"),
    *("trainer.accelerator=cpu", "metrics.qscore=null", "logger=none", "out=sweep"),
    *("callbacks.last.every_minutes=null", "data.clips_per_epoch=40"),
]
"""A sweep of 20 steps a row; its rows are seeds."""
STEPS = [str(step) for step in range(20)]
SLURM = ["hydra/launcher=slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.partition=cpu"]


class Paced(L.Callback):
    """Notes every step that is finished and every end of a training in the row's folder, and takes its time.

    Args:
        folder: the row's, ``${out}``.
        seconds: at least, of a step.
    """

    def __init__(self, folder: str, seconds: float = 0.0) -> None:
        self.path, self.seconds = Path(folder) / "steps.txt", seconds

    def on_train_batch_end(self, trainer: L.Trainer, *_: Any) -> None:
        time.sleep(self.seconds)
        self._note(trainer, str(trainer.global_step - 1))

    def on_test_end(self, trainer: L.Trainer, *_: Any) -> None:
        self._note(trainer, "end")

    def _note(self, trainer: L.Trainer, what: str) -> None:
        if trainer.is_global_zero:
            with self.path.open("a") as file:
                file.write(f"{what} {os.environ.get('SLURM_RESTART_COUNT', 0)} {os.getpid()}\n")


def paced(seconds: float) -> str:
    return f"+callbacks.paced={{_target_: tests.cluster.paced_rows.Paced, folder: '${{out}}', seconds: {seconds}}}"


def row(folder: Path, seed: int) -> Path:
    """Return the folder of the row with this seed."""
    return folder / "sweep" / "rbw_osr_1bit" / "e2e_cnn" / f"seed{seed}"


def noted(folder: Path, seed: int) -> list[str]:
    """Return the steps that a row has finished, from "0", and "end" for every test that it has finished."""
    path = row(folder, seed) / "steps.txt"
    return [line.split()[0] for line in path.read_text().splitlines()] if path.is_file() else []


def weights(folder: Path, seed: int) -> dict[str, torch.Tensor]:
    """Return the weights that a row ended with."""
    last = row(folder, seed) / "checkpoints" / "last.ckpt"
    content: dict[str, torch.Tensor] = torch.load(last, weights_only=True)["state_dict"]
    return content


def same_weights(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[key], other[key]) for key in one)


def process_of(folder: Path, seed: int) -> int:
    """Return the process that made the last step of a row."""
    return int((row(folder, seed) / "steps.txt").read_text().splitlines()[-1].split()[2])
