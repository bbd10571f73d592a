"""A training that has failed says so: its loss jumps, or its validation stays below the mean measurement."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from typing import Any

import lightning as L

from sci_lightning.configuration.bounds import Share
from sci_lightning.console import warn
from sci_lightning.errors import TrainingFailed
from sci_lightning.training.learning_rates import part_done
from sci_lightning.training.scored_pipeline import MEAN_MEASUREMENT
from sci_lightning.training.system import System

RISE = 0.1
"""A validation that is better by less than this, in dB, is no better."""
JUMP = 4.0
"""How many times its least value the loss must be to have jumped; both are medians of ``RECENT`` losses, so that a few
hard batches are no jump. A network whose output saturates raises its loss twentyfold and more."""
RECENT = 10


class FailedTraining(L.Callback):
    """Warns of a training whose validation is below the mean measurement, and ends it if it stays there.

    The mean measurement, repeated in every frame, is what one gets without a decoder. The first validation below it,
    once a part of the run is over, warns; a later one that is still below it and no better ends the training. Between
    validations, which may be half an hour apart, a jump of the loss warns as well; it ends nothing.

    Args:
        after: the part of the run, 0 to 1, before which nothing is said.
        stop: whether such a training is ended; else there is only the warning.
        every_n_steps: batches between two looks at the loss, which waits for the device; 0 for none.

    Raises:
        TrainingFailed: the training is ended. Its checkpoints stay.
    """

    def __init__(self, after: Share = 0.1, stop: bool = True, every_n_steps: int = 10) -> None:
        self.after = after
        self.stop = stop
        self.every_n_steps = every_n_steps
        self._warned_at: float | None = None
        self._losses: deque[float] = deque(maxlen=RECENT)
        self._least = math.inf
        self._jumped = False

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        due = self.every_n_steps and (trainer.fit_loop.total_batch_idx + 1) % self.every_n_steps == 0
        if self._jumped or not due or not isinstance(outputs, Mapping):
            return
        self._losses.append(float(outputs["loss"]))
        if len(self._losses) < RECENT:
            return
        typical = statistics.median(self._losses)
        self._least = min(self._least, typical)
        self._jumped = typical > JUMP * self._least
        if self._jumped and trainer.is_global_zero:
            warn(
                f"step {trainer.global_step}: the loss has risen from {self._least:.3g} to {typical:.3g}, so that the "
                "training may have collapsed; the next validation will show it. If so, start anew with a smaller "
                "system.lr"
            )

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if trainer.sanity_checking or trainer.state.fn != "fit" or not isinstance(pl_module, System):
            return
        reached, mean = (trainer.callback_metrics.get(key) for key in ("val/psnr", f"{MEAN_MEASUREMENT}/psnr"))
        if reached is None or mean is None:
            return
        psnr, done = float(reached), part_done(trainer, trainer.global_step)
        if psnr >= float(mean) or done < self.after:
            return
        line = f"validation reaches {psnr:.1f} dB, less than the mean measurement ({float(mean):.1f} dB)"
        if self._warned_at is None:
            self._warned_at = psnr if math.isfinite(psnr) else -1e9
            if trainer.is_global_zero:
                end = "; it ends if that stays so" if self.stop else ""
                warn(f"{line} after {done:.0%} of the training{end}")
        elif self.stop and done < 1 and not psnr > self._warned_at + RISE:
            raise TrainingFailed(
                f"{line}, and does not rise: stopped at step {trainer.global_step}, after {done:.0%} of the training; "
                f"start anew with a smaller {pl_module.rates}, a longer system.warmup (it is "
                f"{pl_module.rates.warmup:g}) or another seed; "
                "callbacks.failed_training.stop=false goes on all the same"
            )

    def state_dict(self) -> dict[str, Any]:
        state = {"warned_at": self._warned_at, "least": self._least if math.isfinite(self._least) else None}
        return {key: value for key, value in state.items() if value is not None}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        if "warned_at" in state_dict:
            self._warned_at = float(state_dict["warned_at"])
        self._least = float(state_dict.get("least", math.inf))
