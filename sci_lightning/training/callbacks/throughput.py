"""Clips per second of a training, and the share of time in which it waits for data."""

from __future__ import annotations

import time
from typing import Any

import lightning as L

from sci_lightning.training.scoring import as_clips


class Throughput(L.Callback):
    """Logs ``train/clips_per_second`` and ``train/loading_share`` every so many batches, as means over them.

    Clips are counted over all processes; the loading share is the part of the time spent waiting for data.

    Args:
        every_n_steps: batches between two logs; 0 for none.
    """

    def __init__(self, every_n_steps: int = 10) -> None:
        self.every_n_steps = every_n_steps
        self._restart()
        self._ended = 0.0

    def _restart(self) -> None:
        self._clips = 0
        self._busy = 0.0
        self._waited = 0.0

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._ended = time.perf_counter()

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        self._started = time.perf_counter()
        self._waited += self._started - self._ended

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        self._ended = time.perf_counter()
        self._busy += self._ended - self._started
        self._clips += len(as_clips(batch)) * trainer.world_size
        if self.every_n_steps and (trainer.fit_loop.total_batch_idx + 1) % self.every_n_steps == 0:
            total = self._busy + self._waited
            pl_module.log("train/clips_per_second", self._clips / total)
            pl_module.log("train/loading_share", self._waited / total)
            self._restart()

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._paused = time.perf_counter()

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._ended += time.perf_counter() - self._paused  # time in validation is not spent waiting for data
