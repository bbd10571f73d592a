"""Scores kept scene by scene: mean over a scene's frames, then plain mean over scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy

import torch
from torch import nn

from sci_lightning.metrics.frame_metric import FrameMetric


class SceneScores(nn.Module):
    """Every metric for every scene; adds up over processes like the metrics it holds.

    Args:
        names: of the scenes, in the order of their indices.
        metrics: by the name they have in ``metrics.json``; copied.
        every_n_frames: of metrics that look at one frame in so many, by name.
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
        """Scores per scene, ``{scene: {metric: value}}``, and their mean over scenes, ``{metric: value}``.

        Scenes of which no process has seen a frame are left out, as the trainer's ``limit_val_batches`` can have it.
        """
        scenes = {}
        for scene, name in enumerate(self.names):
            found = {key: _frames_and_mean(metric) for key, metric in self._of(scene).items()}
            if any(frames for frames, _ in found.values()):
                scenes[name] = {key: mean for key, (_, mean) in found.items()}
        keys = next(iter(scenes.values()), {})
        return scenes, {key: sum(scene[key] for scene in scenes.values()) / len(scenes) for key in keys}

    def _of(self, scene: int) -> dict[str, FrameMetric]:
        metrics = self.scores[scene]
        assert isinstance(metrics, nn.ModuleDict)
        return {key: metric for key, metric in metrics.items() if isinstance(metric, FrameMetric)}


def _frames_and_mean(metric: FrameMetric) -> tuple[int, float]:
    """How many frames all processes have seen, and the mean of their scores."""
    with metric.sync_context():
        return int(metric.frames), float(type(metric).compute(metric))
