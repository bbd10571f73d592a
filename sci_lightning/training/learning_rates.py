"""Learning rates over a run, and the optimizer that they belong to."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import lightning as L
import torch

from sci_lightning.training.muon import Muon, is_large
from sci_lightning.training.processor_time import time_limits


@dataclass(frozen=True)
class LearningRates:
    """Learning rates that rise from 0 during the warm-up and then fall along a cosine.

    With d the part of the run that is done and w the warm-up, a rate is ``d / w`` of its height, at least 1 %, while
    d < w, and then ``f + (1 - f) (1 + cos(pi (d - w) / (1 - w))) / 2`` of it, where f is ``final_lr / lr``.

    Attributes:
        lr: of Adam at the start.
        final_lr: of Adam at the end; all others fall by the same factor.
        mask_lr: of the mask at the start; None for ``lr``.
        muon_lr: at the start of :class:`~sci_lightning.training.muon.Muon`, which then trains the decoder's large
            weights in Adam's place; None for Adam alone.
        muon_decay: by which part of its learning rate Muon shrinks those weights in every step.
        warmup: part of the run, 0 to below 1.
    """

    lr: float
    final_lr: float
    mask_lr: float | None
    muon_lr: float | None
    muon_decay: float
    warmup: float

    def optimizer(
        self, mask: Iterable[torch.nn.Parameter], weights: Iterable[torch.nn.Parameter], fused: bool
    ) -> torch.optim.Optimizer:
        """Return an optimizer of the mask's parameters, if there are any, and the decoder's weights."""
        mask, weights = [p for p in mask if p.requires_grad], list(weights)
        large = [weight for weight in weights if self.muon_lr is not None and is_large(weight)]
        small = [weight for weight in weights if self.muon_lr is None or not is_large(weight)]
        groups: list[dict[str, Any]] = [{"params": small, "lr": self.lr, "name": "decoder"}]
        if mask:
            groups.append({"params": mask, "lr": self.lr if self.mask_lr is None else self.mask_lr, "name": "mask"})
        if large:
            groups.append({"params": large, "lr": self.muon_lr, "name": "large weights", "muon": True})
        kind: Any = partial(Muon, decay=self.muon_decay) if large else torch.optim.Adam
        optimizer: torch.optim.Optimizer = kind(groups, fused=fused)
        return optimizer

    def factor(self, done: float) -> float:
        """Return a rate's part of its height when the part ``done`` of the run, 0 to 1, is over."""
        if done < self.warmup:
            return max(0.01, done / self.warmup)
        done, floor = (done - self.warmup) / (1 - self.warmup), self.final_lr / self.lr
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
    budget, timer = time_limits(trainer)
    if budget is None and timer is None:
        return 0.0
    spent = 0.0 if budget is None else budget.part_spent
    if timer is not None:
        elapsed = timer.time_elapsed()
        spent = max(spent, elapsed / max(elapsed + (timer.time_remaining() or 0.0), 1e-6))
    return float(trainer.strategy.broadcast(spent))  # clocks differ, learning rates may not
