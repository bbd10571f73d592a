"""The snapshot that a benchmark decodes: the first one of a scene, recorded by a mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from sci_lightning.data.source import Source
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator
from sci_lightning.pipeline import Pipeline

if TYPE_CHECKING:
    from sci_lightning.runs.checkpoint import Checkpoint


def scene_snapshot(
    source: Source, checkpoint: Checkpoint | None, seed: int
) -> tuple[str, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return a scene's name, its measurement ``(1, H, W)``, the mask ``(T, H, W)`` and the video ``(1, T, H, W)``.

    Args:
        source: whose first scene is taken.
        checkpoint: whose encoder records; None: a random binary mask and no sensor.
        seed: of the random mask and the sensor's noise.

    Raises:
        BadInput: a scene of another size than the encoder's mask.
    """
    scene = source.scenes()[0]
    video = scene.video[0][None]
    torch.manual_seed(seed)
    if checkpoint is None:
        mask = (torch.rand(video.shape[1:]) < 0.5).float()
        return scene.name, SnapshotOperator(mask)(video), mask, video
    pipeline = Pipeline(checkpoint.encoder(), checkpoint.decoder())
    with torch.no_grad():
        mask = pipeline.decoder_mask()
        if mask.shape != video.shape[1:]:
            raise BadInput(
                f"the checkpoint's mask is {tuple(mask.shape)} (T, H, W), the scene {tuple(video.shape[1:])}: leave "
                "size= out, or give data of that size"
            )
        return scene.name, pipeline.linearise(pipeline.record(video)), mask, video
