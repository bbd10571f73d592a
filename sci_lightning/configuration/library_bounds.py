"""Ranges of arguments of other people's classes, whose signatures say types only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from annotated_types import Interval

from sci_lightning.configuration.bounds import NonNegative, Repeats

Limit = Annotated[int, Interval(ge=-1, le=10**12)] | None
"""A number of steps or epochs; -1 and None: no limit."""

LIBRARY_BOUNDS: Mapping[str, Mapping[str, Any]] = {
    "lightning.pytorch.trainer.trainer.Trainer": {
        "max_epochs": Limit,
        "min_epochs": Repeats | None,
        "max_steps": Limit,
        "min_steps": Repeats | None,
        "num_nodes": Repeats,
        "accumulate_grad_batches": Repeats,
        "gradient_clip_val": NonNegative | None,
        "log_every_n_steps": Annotated[int, Interval(ge=0, le=10**9)] | None,
        "num_sanity_val_steps": Limit,
        "check_val_every_n_epoch": Repeats | None,
    },
    "lightning.pytorch.callbacks.model_checkpoint.ModelCheckpoint": {
        "save_top_k": Annotated[int, Interval(ge=-1, le=10**6)],
        "every_n_train_steps": Annotated[int, Interval(ge=0, le=10**9)] | None,
        "every_n_epochs": Annotated[int, Interval(ge=0, le=10**9)] | None,
    },
}
"""By the full name of a class and its argument."""
