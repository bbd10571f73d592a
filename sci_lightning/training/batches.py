"""What a loader may give: the batches of our own loaders, and those of plain ones."""

from __future__ import annotations

from typing import Any

import torch

from sci_lightning.errors import BadInput

Batch = tuple[torch.Tensor, ...]
"""Scene numbers (N,) and videos (N, T, H, W); of real captures measurements (N, H, W) and apertures (N,) follow."""

UNNAMED = "all"
"""The one scene of a loader whose data set has no names of scenes."""


def as_batch(batch: Any, named: bool) -> Batch:
    """Return a batch as :data:`Batch`: of a plain loader's videos, bare or alone in a list, all are of one scene.

    Args:
        batch: of a loader.
        named: whether its data set names scenes, so that the batch begins with their numbers.

    Raises:
        BadInput: neither videos nor scene numbers and videos.
    """
    parts = (batch,) if isinstance(batch, torch.Tensor) else tuple(batch) if isinstance(batch, (list, tuple)) else ()
    if not named and len(parts) == 1:
        parts = (torch.zeros(len(parts[0]), dtype=torch.int64), *parts)
    elif not named:
        parts = ()
    if len(parts) < 2 or not isinstance(parts[1], torch.Tensor) or parts[1].ndim != 4:
        raise BadInput(
            "a batch of validation or test is one tensor of videos (N, T, H, W); or (scene numbers (N,), videos) of a "
            "data set with names of scenes in its attribute names"
        )
    return parts


def as_clips(batch: Any) -> torch.Tensor:
    """Return a training batch as clips (N, T, h, w), alone in a list or not; raises BadInput for anything else."""
    clips = batch[0] if isinstance(batch, (list, tuple)) and len(batch) == 1 else batch
    if not isinstance(clips, torch.Tensor) or clips.ndim != 4:
        raise BadInput("a training batch is one tensor of clips (N, T, h, w); the loader gives something else")
    return clips
