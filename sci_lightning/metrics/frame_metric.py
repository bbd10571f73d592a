"""Metrics that are computed frame by frame: their mean over all frames, and scene by scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import nn
from torchmetrics import Metric

from sci_lightning.errors import BadInput
from sci_lightning.full_precision import full_precision
from sci_lightning.plain_text import with_article


class FrameMetric(Metric):
    """The mean over frames of :meth:`score`; sums are kept in float64 and added up over processes."""

    is_differentiable = True
    higher_is_better = True
    full_state_update = False
    smallest = 1
    """Smallest height and width of frames, in pixels."""
    convention = ""
    """The convention that has to be stated wherever the values are printed, in words; empty if there is none."""
    total: torch.Tensor
    frames: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.add_state("total", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("frames", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Return one value per frame, ``(...)``, of two videos ``(..., H, W)``."""
        raise NotImplementedError

    def update(self, estimate: torch.Tensor, truth: torch.Tensor) -> None:
        """Add the frames of two ``(..., H, W)`` videos, nominally in [0, 1].

        Raises:
            BadInput: the two videos differ in shape.
        """
        estimate, truth = as_videos(estimate, truth)
        with full_precision():
            scores = self.score(estimate, truth)
        self.total += scores.sum()
        self.frames += scores.numel()

    def compute(self) -> torch.Tensor:
        return self.total / self.frames

    def plot(self, val: Any = None, ax: Any = None) -> Any:
        """Return figure and axes with the mean so far, or with ``val``, one or more values that calls returned."""
        return self._plot(val, ax)


def as_videos(*videos: torch.Tensor | np.ndarray) -> tuple[torch.Tensor, ...]:
    """Return videos as tensors that can be compared.

    Raises:
        BadInput: they differ in shape, or hold integers: 1.0 is white.
    """
    tensors = tuple(torch.as_tensor(video) for video in videos)
    shapes = [tuple(video.shape) for video in tensors]
    if len(set(shapes)) > 1:
        raise BadInput(f"estimate is {shapes[0]} and truth {shapes[1]}: must be of one shape")
    if not all(video.is_floating_point() for video in tensors):
        kinds = " and ".join(str(video.dtype) for video in tensors)
        raise BadInput(f"estimate and truth are {kinds}, but 1.0 is white; of gray levels give video / 255")
    return tensors


class ImageMetric(FrameMetric):
    """A metric of two images as a metric of videos: computed on every frame, and the mean over the frames.

    Args:
        key: its name, for messages.
        metric: it compares two images ``(1, 1, H, W)``, as those of ``torchmetrics.image`` do.

    Raises:
        BadInput: on the first frame, a metric that does not take them or returns anything but one number.
    """

    def __init__(self, key: str, metric: Metric) -> None:
        super().__init__()
        self.key, self.metric = key, metric

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        pairs = zip(estimate.flatten(0, -3), truth.flatten(0, -3), strict=True)
        return torch.stack([self._compare(*(frame[None, None] for frame in pair)) for pair in pairs])

    def _compare(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        try:
            self.metric.reset()
            self.metric.update(estimate, truth)
            return self.metric.compute().reshape(())
        except Exception as error:  # whatever a metric makes of images that it does not take
            raise BadInput(
                f"metrics.{self.key}: {type(self.metric).__name__} does not compare two frames {tuple(truth.shape)} in "
                f"one number ({' '.join(str(error).split())})"
            ) from error


def as_frame_metric(key: str, metric: object) -> FrameMetric:
    """Return a metric of videos: itself, or any other torchmetrics metric frame by frame.

    Raises:
        BadInput: it is no metric.
    """
    if isinstance(metric, FrameMetric):
        return metric
    if not isinstance(metric, Metric):
        raise BadInput(f"metrics.{key}: {with_article(type(metric).__name__)} is no torchmetrics Metric")
    return ImageMetric(key, metric)


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
