"""How long a training is by its settings: clips, epochs, steps, and its limit of time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput

LIGHTNINGS_EPOCHS = 1000
"""Epochs of a training for which nobody says how many."""


def counted_steps(config: Mapping[str, Any]) -> tuple[int, int, int]:
    """Return the clips of an epoch, the epochs and the steps of the optimizer in all epochs.

    Args:
        config: ``conf/train.yaml``, composed and plain.

    Raises:
        BadInput: settings that leave no step.
    """
    trainer, batch_size = config["trainer"], config["batch_size"]
    clips = config["data"].get("clips_per_epoch") or len(build(config["data"], "data").clips())
    batches = clips // batch_size
    if not batches:
        raise BadInput(f"batch_size={batch_size}: an epoch of {clips} clips has no whole batch")
    if (limit := trainer.get("limit_train_batches")) is not None:
        batches = int(batches * limit) if isinstance(limit, float) else min(batches, limit)
        if not batches:
            raise BadInput(f"trainer.limit_train_batches={limit}: leaves no batch of {clips // batch_size}")
    parts = trainer["accumulate_grad_batches"]
    per_epoch, epochs = math.ceil(batches / parts), trainer["max_epochs"]
    if epochs is None or epochs < 0:  # as Lightning has it: no end, or as many as the steps fill
        epochs = math.ceil(trainer["max_steps"] / per_epoch) if trainer["max_steps"] > 0 else LIGHTNINGS_EPOCHS
    steps = per_epoch * epochs
    if trainer["max_steps"] > 0:
        steps = min(steps, trainer["max_steps"])
    return clips, epochs, steps


def most_seconds(trainer: Mapping[str, Any]) -> float | None:
    """Return the limit on the duration of a training, ``trainer.max_time``; None without one.

    Raises:
        BadInput: it cannot be read.
    """
    limit = trainer.get("max_time")
    if not limit:
        return None
    from lightning.fabric.utilities.exceptions import MisconfigurationException
    from lightning.pytorch.callbacks import Timer

    try:
        return Timer(build(limit, "trainer.max_time") if isinstance(limit, Mapping) else limit).time_remaining()
    except (MisconfigurationException, TypeError) as error:
        raise BadInput(f"trainer.max_time={limit}: expected DD:HH:MM:SS, as in 00:00:30:00") from error
