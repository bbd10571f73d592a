"""How far a training has come: one number, from which everything else follows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import lightning as L

from sci_lightning.errors import BadInput

LARGEST = 2**40
"""More steps than any training makes; a file that tells of more is damaged or made to do harm."""


@dataclass(frozen=True)
class TrainingPosition:
    """Where a training stands: the place of the next batch follows from the number of optimizer steps.

    A checkpoint keeps this instead of the states of Lightning's loops. Those say the same a dozen times over, disagree
    after a training was resumed at the end of an epoch (Lightning 2.6 then forgets the next epoch's beginning, and a
    second resume repeats it), and would be trusted blindly when read from a file.

    Attributes:
        steps: optimizer steps that were made.
        batches_per_epoch: batches of an epoch, on one process.
        validated: whether the validation that may follow the last batch has been run.
    """

    steps: int
    batches_per_epoch: int
    validated: bool

    @classmethod
    def of(cls, trainer: L.Trainer, validated: bool) -> TrainingPosition:
        """The position of a trainer."""
        return cls(trainer.global_step, int(trainer.num_training_batches), validated)

    @classmethod
    def read(cls, path: object, content: Mapping[str, Any], batches_per_epoch: int) -> TrainingPosition:
        """The position that a checkpoint holds.

        Args:
            path: of the checkpoint, for messages.
            content: of the checkpoint. One without ``position`` was written before there was such an entry: its
                ``global_step`` counts.
            batches_per_epoch: of the present data.

        Raises:
            BadInput: it is not a position, or one in epochs of another length.
        """
        known = content.get("position", {"steps": content.get("global_step"), "batches_per_epoch": batches_per_epoch})
        known = {"validated": True, **known} if isinstance(known, dict) else {}
        steps, batches, validated = (known.get(key) for key in ("steps", "batches_per_epoch", "validated"))
        whole = all(type(value) is int and 0 <= value < LARGEST for value in (steps, batches))
        if not whole or type(validated) is not bool or not batches:
            raise BadInput(f"{path}: damaged: it does not say how many steps of the training were made")
        if batches != batches_per_epoch:
            raise BadInput(
                f"{path}: an epoch had {batches} batches, now it has {batches_per_epoch}: go on with the same clips, "
                "batch_size and number of processes"
            )
        assert isinstance(steps, int)
        return cls(steps, batches_per_epoch, validated)

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return asdict(self)

    def place(self, accumulate: int = 1) -> tuple[int, int]:
        """Epoch and batch, both from 0, of the next batch; the batch is ``batches_per_epoch`` before the validation.

        Args:
            accumulate: batches whose gradients make one optimizer step; the last ones of an epoch may be fewer.
        """
        epoch, steps = divmod(self.steps, math.ceil(self.batches_per_epoch / accumulate))
        if steps == 0 and self.steps and not self.validated:
            return epoch - 1, self.batches_per_epoch
        return epoch, steps * accumulate

    def check_plan(self, path: object, trainer: L.Trainer) -> None:
        """Refuse to go on with a training that has gone further than it is asked to go; raises BadInput."""
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
        """The states of Lightning's loops with which its trainer goes on from here."""
        epoch, batch = self.place(trainer.accumulate_grad_batches)
        batches = epoch * self.batches_per_epoch + batch
        within = _counts(1) if batch else _counts(0)  # of an epoch that was begun, beside the finished ones
        begun = {key: epoch + within[key] * (key in ("ready", "started")) for key in within}
        # a batch that was begun and never processed: Lightning runs a validation first, if one is due here
        pending = _counts(1, processed=0, completed=0) if batch and not self.validated else _counts(0)
        step = {key: {k: n for k, n in _counts(self.steps).items() if k in ("ready", "completed")} for key in TOTALS}
        return {
            "fit_loop": {
                "epoch_progress": dict.fromkeys(TOTALS, begun),
                "epoch_loop.state_dict": {"_batches_that_stepped": self.steps - (batch == self.batches_per_epoch)},
                "epoch_loop.batch_progress": {
                    "total": _counts(batches),
                    "current": _counts(batch),
                    "is_last_batch": batch == self.batches_per_epoch,
                },
                "epoch_loop.scheduler_progress": step,
                "epoch_loop.automatic_optimization.optim_progress": {
                    "optimizer": {
                        "step": step,
                        "zero_grad": {key: _counts(self.steps, processed=None) for key in TOTALS},
                    }
                },
                "epoch_loop.val_loop.batch_progress": {
                    "total": pending,
                    "current": _counts(0),
                    "is_last_batch": False,
                },
            }
        }


TOTALS = ("total", "current")
"""Lightning counts everything over the whole training and within an epoch."""


def _counts(number: int, **others: int | None) -> dict[str, int]:
    """Lightning's four counters, all at ``number`` but for ``others``; None leaves one out."""
    counts = {**dict.fromkeys(("ready", "started", "processed", "completed"), number), **others}
    return {key: value for key, value in counts.items() if value is not None}
