"""A training's budget in processor time, so that a loaded machine does not change what is learned."""

from __future__ import annotations

import math
import time
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Timer

from sci_lightning.configuration.bounds import Positive
from sci_lightning.errors import BadInput


class ProcessorTime(L.Callback):
    """Ends a training after so many minutes of processor time; the learning rate falls over them.

    What counts is the time that all threads of this process have computed for training steps and the loading of clips:
    neither validation nor the test that follows, nor the time in which other programs had the processor. A resumed
    training goes on counting from what its checkpoint says.

    Args:
        minutes: of one core; two threads use them up in half the time.
    """

    def __init__(self, minutes: Positive) -> None:
        self.budget = 60.0 * minutes
        self.seconds = 0.0
        self._counted_until = 0.0

    @property
    def part_spent(self) -> float:
        """The part of the budget that is spent, 0 to 1."""
        return min(1.0, self.seconds / self.budget)

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._counted_until = time.process_time()
        self._stop_if_spent(trainer)

    def on_train_batch_end(self, trainer: L.Trainer, *args: Any) -> None:
        self._count()
        self._stop_if_spent(trainer)

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._count()

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._counted_until = time.process_time()

    def state_dict(self) -> dict[str, Any]:
        return {"seconds": self.seconds}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        seconds = state_dict["seconds"]
        if type(seconds) not in (int, float) or not (math.isfinite(seconds) and seconds >= 0):
            raise BadInput("no time that was spent")
        self.seconds = float(seconds)

    def _count(self) -> None:
        now = time.process_time()
        self.seconds += now - self._counted_until
        self._counted_until = now

    def _stop_if_spent(self, trainer: L.Trainer) -> None:
        spent = self.seconds >= self.budget
        if trainer.world_size > 1:  # clocks differ; all processes end with the same step
            spent = trainer.strategy.reduce_boolean_decision(spent, all=False)
        trainer.should_stop = trainer.should_stop or spent


def time_limits(trainer: L.Trainer) -> tuple[ProcessorTime | None, Timer | None]:
    """Return the limit on a training's processor time and that on its duration (``max_time``); None where it has none.

    Args:
        trainer: of the training.
    """
    budget = timer = None
    for callback in trainer.callbacks:  # type: ignore[attr-defined]  # set by Lightning, not declared
        if isinstance(callback, ProcessorTime):
            budget = callback
        elif isinstance(callback, Timer) and callback.time_remaining() is not None:
            timer = callback
    return budget, timer
