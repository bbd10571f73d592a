"""Metrics scene by scene: the mean over the frames of every scene, then the mean over scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy

import torch
from torch import nn

from sci_lightning.metrics.frame_metric import FrameMetric


class SceneScores(nn.Module):
    """A copy of every metric for every scene, which adds up over processes.

    Args:
        names: names of the scenes, in the order of their numbers.
        metrics: metrics by their name in ``metrics.json``; they are copied.
        every_n_frames: by name, for metrics that are computed on one frame in so many only.
    """

    def __init__(
        self,
        names: Sequence[str],
        metrics: Mapping[str, FrameMetric],
        every_n_frames: Mapping[str, int] | None = None,
    ) -> None:
        super().__init__()
        self.names = list(names)
        self.every_n_frames = every_n_frames or {}
        self.scores = nn.ModuleList(nn.ModuleDict(deepcopy(dict(metrics))) for _ in names)

    def update(self, scene: int, estimate: torch.Tensor, truth: torch.Tensor) -> None:
        """Add the frames of two ``(..., T, H, W)`` videos of scene number ``scene``."""
        for key, metric in self._of(scene).items():
            step = min(self.every_n_frames.get(key, 1), truth.shape[-3])
            metric.update(*(video[..., step // 2 :: step, :, :] for video in (estimate, truth)))

    def compute(self) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
        """Return the values ``{scene: {metric: value}}`` and their mean over scenes, ``{metric: value}``.

        Scenes of which no process has seen a frame are left out; ``limit_val_batches`` of the trainer can cause that.
        """
        scenes = {}
        for scene, name in enumerate(self.names):
            values = {key: _frames_and_mean(metric) for key, metric in self._of(scene).items()}
            if any(frames for frames, _ in values.values()):
                scenes[name] = {key: mean for key, (_, mean) in values.items()}
        keys = next(iter(scenes.values()), {})
        return scenes, {key: sum(scene[key] for scene in scenes.values()) / len(scenes) for key in keys}

    def _of(self, scene: int) -> dict[str, FrameMetric]:
        return {key: metric for key, metric in self.scores[scene].named_children() if isinstance(metric, FrameMetric)}


def _frames_and_mean(metric: FrameMetric) -> tuple[int, float]:
    """Return the number of frames that all processes have seen, and the mean of the metric over them."""
    with metric.sync_context():
        return int(metric.frames), float(type(metric).compute(metric))
