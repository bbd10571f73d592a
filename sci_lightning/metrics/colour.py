"""Metrics of gray frames as metrics of videos in colour: of every channel, and their mean."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from sci_lightning.configuration.bounds import CHANNELS
from sci_lightning.metrics.frame_metric import FrameMetric


class ColourMetric(FrameMetric):
    """A metric of gray frames on videos ``(3, T, H, W)``, red, green and blue.

    Args:
        metric: compares two videos ``(.., H, W)`` frame by frame.
        channel: 0 to 2; None for the mean of all three.
    """

    def __init__(self, metric: FrameMetric, channel: int | None = None) -> None:
        super().__init__()
        self.metric, self.channel = metric, channel
        if channel is None:
            self.convention = ", ".join(filter(None, [metric.convention, "mean of red, green and blue"]))

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        if self.channel is not None:
            return self.metric.score(estimate[self.channel], truth[self.channel])
        return torch.stack([self.metric.score(*pair) for pair in zip(estimate, truth, strict=True)])


def in_colour(metrics: Mapping[str, FrameMetric]) -> dict[str, FrameMetric]:
    """Return the means over the channels of metrics by their names, and ``psnr_red`` and its like of each channel."""
    means: dict[str, FrameMetric] = {name: ColourMetric(metric) for name, metric in metrics.items()}
    return means | {
        f"{name}_{channel}": ColourMetric(metric, number)
        for name, metric in metrics.items()
        for number, channel in enumerate(CHANNELS)
    }
