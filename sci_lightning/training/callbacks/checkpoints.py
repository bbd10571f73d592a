"""Checkpoints of a training: ``last.ckpt``, from which it resumes, and ``best.ckpt``.

Lightning's ``ModelCheckpoint`` breaks three promises. Its state holds paths, which are never taken from a file that may
be a stranger's, so that a resumed training would not know its best value. It keeps the first validation as the best
even if that is NaN. And it knows no request to stop, after which the step is finished, the loggers are saved,
``last.ckpt`` is written and the training ends; nor does it save before a step that takes longer than the interval.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Checkpoint

from sci_lightning.configuration.bounds import NonNegative, Repeats
from sci_lightning.training.stop_signal import Stopped, StopSignal

LONG_STEP = 15.0
"""Seconds of a batch from which on a checkpoint does not wait for another one that would end too late."""


class LastCheckpoint(Checkpoint):
    """Writes ``last.ckpt`` every few minutes or steps of a training, and when the training is asked to stop.

    Args:
        folder: the folder in which it is written.
        every_minutes: minutes of training between two, at most, unless a single step takes longer; None for never.
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
        self._step, self._begun = 0, 0.0
        self._longest = 0.0  # seconds that a batch has taken

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._written_at, self._written_step, self._stopping = time.monotonic(), trainer.global_step, False
        self._step, self._longest = trainer.global_step, 0.0
        if self.stop is not None:
            self.stop.lost = self._lost
            self.stop.wait_for_step()

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        self._step, self._longest = trainer.global_step, max(self._longest, time.monotonic() - self._begun)
        stop = self.stop is not None and self.stop.requested
        if self._agreed(trainer, stop or self._is_due(trainer)):
            self._write(trainer)
            self._stopping = self._agreed(trainer, stop)  # once the loggers have this step, which they get after this

    def on_train_batch_start(self, *args: Any) -> None:
        self._end_if_stopping()
        self._begun = time.monotonic()

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
        if self.every_minutes is None:
            return False
        next_end = time.monotonic() + (self._longest if self._longest > LONG_STEP else 0.0)
        return next_end - self._written_at >= 60 * self.every_minutes

    def _lost(self) -> str:
        """Return, in words, what ends with the process if it ends now."""
        steps, minutes = self._step - self._written_step, (time.monotonic() - self._written_at) / 60
        last = "last.ckpt" if self.path.is_file() else "the beginning: there is no last.ckpt yet"
        done = f"{steps} finished step{'s' * (steps != 1)}"
        return f"{done} and the one that is being computed, {minutes:.1f} minutes since {last}"

    def _write(self, trainer: L.Trainer) -> None:
        for logger in trainer.loggers:
            logger.save()  # a run that is killed later goes on from here, and its log as well
        trainer.save_checkpoint(self.path)
        self._written_at, self._written_step = time.monotonic(), trainer.global_step

    def _agreed(self, trainer: L.Trainer, wish: bool) -> bool:
        """Return whether any process wishes it: clocks differ, and a signal may reach one process only."""
        return wish if trainer.world_size == 1 else trainer.strategy.reduce_boolean_decision(wish, all=False)


class BestCheckpoint(Checkpoint):
    """Writes ``best.ckpt`` after every validation that is better than all before it.

    Its state is the best value, never a path: a resumed training compares with it as long as ``best.ckpt`` exists.

    Args:
        folder: the folder in which it is written.
        monitor: the logged metric; larger is better.
    """

    def __init__(self, folder: str | Path, monitor: str = "val/psnr") -> None:
        self.path = Path(folder) / "best.ckpt"
        self.monitor = monitor
        self.best = -math.inf

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not trainer.strategy.broadcast(self.path.is_file()):
            self.best = -math.inf

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        value = trainer.callback_metrics.get(self.monitor)
        if value is None or trainer.sanity_checking or trainer.state.fn != "fit" or not float(value) > self.best:
            return
        self.best = float(value)
        trainer.save_checkpoint(self.path)

    def state_dict(self) -> dict[str, Any]:
        return {"best": self.best} if math.isfinite(self.best) else {}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.best = float(state_dict["best"])
