"""How long a training is by its settings: clips, steps, validations, and its limit of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from sci_lightning.configuration.build import build
from sci_lightning.data.source import Scene, Source
from sci_lightning.errors import BadInput

LIGHTNINGS_EPOCHS = 1000
"""Epochs of a training for which nobody says how many."""


def source_of(config: Mapping[str, Any]) -> Source | None:
    """Build the source of video of a configuration; return None if ``data.root`` is missing."""
    return None if config["data"].get("root") == "???" else build(config["data"], "data")


def counted_steps(config: Mapping[str, Any], source: Source | None) -> tuple[int, int, int]:
    """Return the clips of an epoch, the steps of the optimizer in one epoch and in all epochs.

    Args:
        config: ``conf/train.yaml``, composed and plain.
        source: of video; None where ``data.clips_per_epoch`` says all.

    Raises:
        BadInput: settings that leave no step, or a source without clips.
    """
    trainer, batch_size = config["trainer"], config["batch_size"]
    clips = config["data"]["clips_per_epoch"] if source is None else len(source.clips())
    batches = clips // batch_size
    if not batches:
        raise BadInput(f"batch_size={batch_size}: an epoch of {clips} clips has no whole batch")
    batches = _limited(batches, limit := trainer.get("limit_train_batches"))
    if not batches:
        raise BadInput(f"trainer.limit_train_batches={limit}: leaves no batch of {clips // batch_size}")
    parts = trainer["accumulate_grad_batches"]
    per_epoch, epochs = math.ceil(batches / parts), trainer["max_epochs"]
    if epochs is None or epochs < 0:  # as Lightning has it: no end, or as many as the steps fill
        epochs = math.ceil(trainer["max_steps"] / per_epoch) if trainer["max_steps"] > 0 else LIGHTNINGS_EPOCHS
    steps = per_epoch * epochs
    if trainer["max_steps"] > 0:
        steps = min(steps, trainer["max_steps"])
    return clips, per_epoch, steps


def steps_between_validations(trainer: Mapping[str, Any], per_epoch: int) -> float:
    """Return after how many steps of the optimizer a validation follows.

    Args:
        trainer: its settings.
        per_epoch: steps in an epoch.
    """
    interval = trainer.get("val_check_interval")
    if isinstance(interval, int):
        return max(1.0, interval / trainer.get("accumulate_grad_batches", 1))
    share = interval if isinstance(interval, float) else 1.0
    return max(1.0, share * per_epoch * (trainer.get("check_val_every_n_epoch") or 1))


def counted_snapshots(scenes: Iterable[Scene], limit: float | None) -> int:
    """Return the snapshots of a validation or a test, of which ``trainer.limit_val_batches`` may take a part."""
    return _limited(sum(len(scene.video) for scene in scenes), limit)


def _limited(batches: int, limit: float | None) -> int:
    """Return what a limit of Lightning's leaves: a share where it is a fraction, else a number."""
    if limit is None:
        return batches
    return int(batches * limit) if isinstance(limit, float) else min(batches, limit)


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
