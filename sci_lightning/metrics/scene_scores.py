"""Scores kept scene by scene: mean over a scene's frames, then plain mean over scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import nn
from torchmetrics import MetricCollection

from sci_lightning.metrics.frame_metric import FrameMetric
from sci_lightning.metrics.psnr import PSNR
from sci_lightning.metrics.ssim import SSIM

METRICS: Mapping[str, type[FrameMetric]] = {"psnr": PSNR, "ssim": SSIM}


class SceneScores(nn.Module):
    """Every metric for every scene; adds up over processes like the metrics it holds.

    Args:
        names: of the scenes, in the order of their indices.
        metrics: by the name they have in ``metrics.json``.
    """

    def __init__(self, names: Sequence[str], metrics: Mapping[str, type[FrameMetric]] = METRICS) -> None:
        super().__init__()
        self.names = list(names)
        self.scores = nn.ModuleList(MetricCollection({key: made() for key, made in metrics.items()}) for _ in names)

    def update(self, scene: int, estimate: torch.Tensor, truth: torch.Tensor) -> None:
        """Add the frames of two ``(..., H, W)`` videos of scene number ``scene``."""
        self._of(scene).update(estimate, truth)

    def compute(self) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
        """Scores per scene, ``{scene: {metric: value}}``, and their mean over scenes, ``{metric: value}``."""
        scenes = {
            name: {key: float(value) for key, value in self._of(scene).compute().items()}
            for scene, name in enumerate(self.names)
        }
        keys = next(iter(scenes.values()), {})
        return scenes, {key: sum(scene[key] for scene in scenes.values()) / len(scenes) for key in keys}

    def _of(self, scene: int) -> MetricCollection:
        metrics = self.scores[scene]
        assert isinstance(metrics, MetricCollection)
        return metrics
