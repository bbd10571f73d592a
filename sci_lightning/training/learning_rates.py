"""Learning rates over a run, the optimizer they belong to, and the processor time over which they may fall."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer

from sci_lightning.configuration.bounds import Positive
from sci_lightning.errors import BadInput
from sci_lightning.training.muon import Muon, is_large


@dataclass(frozen=True)
class LearningRates:
    """Learning rates that rise from 0 during the warm-up and then fall: along a cosine, or at the end of the run only.

    With d the part of the run that is done and w the warm-up, a rate is ``d / w`` of its height, at least 1 %, while
    d < w, and then ``f + (1 - f) (1 + cos(pi (d - w) / (1 - w))) / 2`` of it, where f is ``final_lr / lr``. With a
    cooldown c it stays at its height until d = 1 - c, and is then ``f + (1 - f) (1 - d) / c`` of it: a training that
    another one goes on from loses little by having ended.

    Attributes:
        lr: of Adam at the start.
        final_lr: of Adam at the end; all others fall by the same factor.
        mask_lr: of the mask at the start; None for ``lr``.
        muon_lr: at the start of :class:`~sci_lightning.training.muon.Muon`, which then trains the decoder's large
            weights in Adam's place; None for Adam alone.
        muon_decay: by which part of its learning rate Muon shrinks those weights in every step.
        warmup: part of the run, 0 to below 1.
        cooldown: part of the run, above 0 and up to 1 - warmup; None for the cosine.
    """

    lr: float
    final_lr: float
    mask_lr: float | None
    muon_lr: float | None
    muon_decay: float
    warmup: float
    cooldown: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.warmup < 1:
            raise BadInput(f"system.warmup={self.warmup}: a part of the run, from 0 to below 1, as in 0.02")
        if self.cooldown is not None and not 0 < self.cooldown <= 1 - self.warmup:
            raise BadInput(f"system.cooldown={self.cooldown}: above 0 and at most 1 - system.warmup, or null")

    def optimizer_and_schedule(
        self, trainer: L.Trainer, mask: Iterable[torch.nn.Parameter], weights: Iterable[torch.nn.Parameter]
    ) -> dict[str, Any]:
        """Return what ``configure_optimizers`` does, for the mask's parameters, if it has any, and the weights."""
        mask, weights = [p for p in mask if p.requires_grad], list(weights)
        large = [weight for weight in weights if self.muon_lr is not None and is_large(weight)]
        small = [weight for weight in weights if self.muon_lr is None or not is_large(weight)]
        groups: list[dict[str, Any]] = [{"params": small, "lr": self.lr, "name": "decoder"}]
        if mask:
            groups.append({"params": mask, "lr": self.lr if self.mask_lr is None else self.mask_lr, "name": "mask"})
        if large:
            groups.append({"params": large, "lr": self.muon_lr, "name": "large weights", "muon": True})
        kind: Any = partial(Muon, decay=self.muon_decay) if large else torch.optim.Adam
        # the fused one is twice as fast and differs in the last bits; scaled gradients of float16 it would not clip
        optimizer = kind(groups, fused=trainer.precision == "bf16-mixed")

        def schedule(step: int) -> float:
            # asking for the number of steps before the first would set up the loader before its place is restored
            return self.factor(part_done(trainer, step) if step else 0.0)

        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, schedule)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def factor(self, done: float) -> float:
        """Return a rate's part of its height when the part ``done`` of the run, 0 to 1, is over."""
        if done < self.warmup:
            return max(0.01, done / self.warmup)
        floor = self.final_lr / self.lr
        if self.cooldown is not None:
            return floor + (1 - floor) * min(1.0, (1 - done) / self.cooldown)
        done = (done - self.warmup) / (1 - self.warmup)
        return floor + (1 - floor) * (1 + math.cos(math.pi * done)) / 2

    def __str__(self) -> str:
        """The decoder's learning rates as words for a message: ``system.lr (it is 0.002)``."""
        rates = {"system.lr": self.lr, "system.muon_lr": self.muon_lr}
        return " and ".join(f"{name} (it is {rate:g})" for name, rate in rates.items() if rate is not None)


def part_done(trainer: L.Trainer, steps: int) -> float:
    """Return the part of a run, 0 to 1, that is over after so many optimizer steps; 0 in a run without end.

    A run ends after its steps, after the trainer's ``max_time`` or its processor time, whichever comes first.
    """
    return min(1.0, max(_time_spent(trainer), steps / trainer.estimated_stepping_batches))


def _time_spent(trainer: L.Trainer) -> float:
    """Return the part of ``max_time`` or of the processor time that has passed, 0 to 1; 0 in a run without one."""
    spent = []
    for callback in trainer.callbacks:  # type: ignore[attr-defined]  # set by Lightning, not declared
        if isinstance(callback, ProcessorTime):
            spent.append(callback.part_spent)
        elif isinstance(callback, Timer) and (left := callback.time_remaining()) is not None:
            elapsed = callback.time_elapsed()
            spent.append(elapsed / max(elapsed + left, 1e-6))
    return float(trainer.strategy.broadcast(max(spent))) if spent else 0.0  # clocks differ, learning rates may not


class LeaseEnd(Timer):
    """Ends a training at a point in time, however long its start has taken; the learning rate falls until then.

    Args:
        until: seconds since 1970.
    """

    def __init__(self, until: Positive) -> None:
        super().__init__(timedelta(seconds=max(1.0, until - time.time())))


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
