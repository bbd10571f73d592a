"""``checkpoints/last.ckpt``: the state from which an interrupted training resumes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Checkpoint

from sci_lightning.configuration.bounds import NonNegative, Repeats
from sci_lightning.training.stop_signal import Stopped, StopSignal


class LastCheckpoint(Checkpoint):
    """Writes ``last.ckpt`` every few minutes or steps of a training, and when the training is asked to stop.

    Args:
        folder: the folder in which it is written.
        every_minutes: minutes of training between two; None for never.
        every_n_steps: optimizer steps between two; None for never.
        stop: the request to stop; None if there cannot be one.

    Raises:
        Stopped: after a request to stop, once the current step is finished and ``last.ckpt`` is written.
    """

    def __init__(
        self,
        folder: str | Path,
        every_minutes: NonNegative | None = 2.0,
        every_n_steps: Repeats | None = None,
        stop: StopSignal | None = None,
    ) -> None:
        self.path = Path(folder) / "last.ckpt"
        self.every_minutes = every_minutes
        self.every_n_steps = every_n_steps
        self.stop = stop
        self._written_at = 0.0
        self._written_step = 0
        self._stopping = False

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._written_at, self._written_step, self._stopping = time.monotonic(), trainer.global_step, False
        if self.stop is not None:
            self.stop.wait_for_step()

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        stop = self.stop is not None and self.stop.requested
        if self._agreed(trainer, stop or self._is_due(trainer)):
            self._write(trainer)
            self._stopping = self._agreed(trainer, stop)  # once the loggers have this step, which they get after this

    def on_train_batch_start(self, *args: Any) -> None:
        self._end_if_stopping()

    def on_validation_start(self, *args: Any) -> None:
        self._end_if_stopping()

    def on_train_epoch_end(self, *args: Any) -> None:
        self._end_if_stopping()

    def on_validation_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *args: Any) -> None:
        stop = self.stop is not None and self.stop.requested
        if trainer.state.fn == "fit" and trainer.world_size == 1 and stop:
            self._write(trainer)
            raise Stopped

    def _end_if_stopping(self) -> None:
        if self._stopping:
            raise Stopped

    def _is_due(self, trainer: L.Trainer) -> bool:
        if trainer.global_step == self._written_step:  # gradients of several batches may make one step
            return False
        if self.every_n_steps is not None and trainer.global_step % self.every_n_steps == 0:
            return True
        return self.every_minutes is not None and time.monotonic() - self._written_at >= 60 * self.every_minutes

    def _write(self, trainer: L.Trainer) -> None:
        for logger in trainer.loggers:
            logger.save()  # a run that is killed later goes on from here, and its log as well
        trainer.save_checkpoint(self.path)
        self._written_at, self._written_step = time.monotonic(), trainer.global_step

    def _agreed(self, trainer: L.Trainer, wish: bool) -> bool:
        """Return whether any process wishes it: clocks differ, and a signal may reach one process only."""
        return wish if trainer.world_size == 1 else trainer.strategy.reduce_boolean_decision(wish, all=False)
