"""How long a training is going to take, said at its start."""

from __future__ import annotations

import time
from typing import Any

import lightning as L

from sci_lightning.configuration.bounds import NonNegative
from sci_lightning.training.processor_time import time_limits
from sci_lightning.training.training_plan import duration_line


class ExpectedTime(L.Callback):
    """Prints, once a few steps have been timed, how long the training takes on this machine.

    The first step is left out, which allocates memory and compiles.

    Args:
        after_seconds: of steps that are timed, at least; and at least one step.
    """

    def __init__(self, after_seconds: NonNegative = 5.0) -> None:
        self.after_seconds = after_seconds
        self._first: tuple[int, float] | None = None
        self._said = False

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._first, self._said = None, False

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._first = None  # its time is none of a step's

    def on_train_batch_end(self, trainer: L.Trainer, *args: Any) -> None:
        now, step = time.perf_counter(), trainer.global_step
        if self._said or not trainer.is_global_zero:
            return
        if self._first is None:
            self._first = (step, now)
        elif step > self._first[0] and now - self._first[1] >= self.after_seconds:
            self._said = True
            left = trainer.estimated_stepping_batches - step
            seconds = (now - self._first[1]) / (step - self._first[0])
            budget, timer = time_limits(trainer)
            minutes = None if budget is None else (budget.budget - budget.seconds) / 60
            most = None if timer is None else timer.time_remaining()
            print(f"{seconds:.3g} s a step: {duration_line(left * seconds, minutes, most)}", flush=True)
