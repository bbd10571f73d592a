"""The position of a training: the number of optimizer steps, from which everything else follows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

import lightning as L

from sci_lightning.errors import BadInput

MAX_STEPS = 2**40
"""More steps than any training makes; a file with more is damaged or malicious."""


@dataclass(frozen=True)
class TrainingPosition:
    """The position of a training; the next batch follows from the number of optimizer steps.

    A checkpoint keeps this instead of the states of Lightning's loops. Those hold the same number a dozen times,
    disagree after a training was resumed at the end of an epoch (Lightning 2.6 then forgets that the next epoch began,
    and a second resume repeats it), and Lightning would trust them without a check when they are read from a file.

    Attributes:
        steps: optimizer steps made so far.
        batches_per_epoch: batches of an epoch in one process.
        validated: whether the validation that may follow the last batch has been run.
    """

    steps: int
    batches_per_epoch: int
    validated: bool

    @classmethod
    def read(cls, path: object, content: Mapping[str, Any], batches_per_epoch: int) -> TrainingPosition:
        """Return the position that a checkpoint holds.

        Args:
            path: the checkpoint's path, for messages.
            content: the checkpoint's content.
            batches_per_epoch: batches of an epoch with the present data.

        Raises:
            BadInput: the entry is damaged, or an epoch had another number of batches.
        """
        known = content.get("position")
        known = known if isinstance(known, dict) else {}
        steps, batches, validated = (known.get(key) for key in ("steps", "batches_per_epoch", "validated"))
        if not (_is_count(steps) and _is_count(batches) and batches and type(validated) is bool):
            raise BadInput(f"{path}: damaged: it does not say how many steps of the training were made")
        if batches != batches_per_epoch:
            raise BadInput(
                f"{path}: an epoch had {batches} batches, now it has {batches_per_epoch}: go on with the same clips, "
                "batch_size and number of processes"
            )
        return cls(steps, batches_per_epoch, validated)

    def place(self, accumulate: int = 1) -> tuple[int, int]:
        """Return epoch and batch, from 0, of the next batch; the batch is ``batches_per_epoch`` before a validation.

        Args:
            accumulate: batches per optimizer step; the last step of an epoch may have fewer.
        """
        epoch, steps = divmod(self.steps, math.ceil(self.batches_per_epoch / accumulate))
        if steps == 0 and self.steps and not self.validated:
            return epoch - 1, self.batches_per_epoch
        return epoch, steps * accumulate

    def check_plan(self, path: object, trainer: L.Trainer) -> None:
        """Raise BadInput if the training has already gone further than the trainer's limits."""
        epoch, batch = self.place(trainer.accumulate_grad_batches)
        epochs = epoch + (batch > 0)
        for key, limit, done in (
            ("max_steps", trainer.max_steps, self.steps),
            ("max_epochs", trainer.max_epochs, epochs),
        ):
            if limit is not None and limit != -1 and done > limit:
                raise BadInput(
                    f"{path}: {self.steps} steps were made, in epoch {epochs}: more than trainer.{key}={limit} asks "
                    "for; raise it"
                )

    def loops(self, trainer: L.Trainer) -> dict[str, Any]:
        """Return the states of Lightning's loops with which its trainer continues from this position."""
        epoch, batch = self.place(trainer.accumulate_grad_batches)
        ended = batch == self.batches_per_epoch
        begun = epoch + (batch > 0)
        epochs = {"ready": begun, "started": begun, "processed": epoch, "completed": epoch}
        steps = {"ready": self.steps, "completed": self.steps}
        # a batch that was begun and never processed: Lightning runs a validation first, if one is due here
        pending = {**_counts(0), **dict.fromkeys(("ready", "started"), int(batch > 0 and not self.validated))}
        return {
            "fit_loop": {
                "epoch_progress": dict.fromkeys(TOTALS, epochs),
                # a private name, but the only one of the step under which loggers file a batch
                "epoch_loop.state_dict": {"_batches_that_stepped": self.steps - ended},
                "epoch_loop.batch_progress": {
                    "total": _counts(epoch * self.batches_per_epoch + batch),
                    "current": _counts(batch),
                    "is_last_batch": ended,
                },
                "epoch_loop.automatic_optimization.optim_progress": {
                    "optimizer": dict.fromkeys(("step", "zero_grad"), dict.fromkeys(TOTALS, steps))
                },
                "epoch_loop.val_loop.batch_progress": {
                    "total": pending,
                    "current": _counts(0),
                    "is_last_batch": False,
                },
            }
        }


def _is_count(value: object) -> TypeGuard[int]:
    """Return whether a value from a file is a plausible number of steps or batches; a bool is not."""
    return type(value) is int and 0 <= value < MAX_STEPS


TOTALS = ("total", "current")
"""Lightning counts everything over the whole training and within an epoch."""


def _counts(number: int) -> dict[str, int]:
    """Return Lightning's four counters of batches."""
    return dict.fromkeys(("ready", "started", "processed", "completed"), number)
