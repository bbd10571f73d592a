"""Validation and test: snapshots are recorded, decoded and scored scene by scene."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder.sensor.bayer import demosaiced
from sci_lightning.errors import BadInput
from sci_lightning.metrics.frame_metric import FrameMetric, SceneScores, as_frame_metric
from sci_lightning.operator import SnapshotOperator
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.device import device_name

Batch = tuple[torch.Tensor, ...]
"""Scene numbers (N,) and videos (N, T, H, W), in colour (N, 3, T, H, W); of real captures measurements (N, H, W) and
apertures (N,) follow."""

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
    if len(parts) < 2 or not isinstance(parts[1], torch.Tensor) or parts[1].ndim not in (4, 5):
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


class Scoring:
    """The scores of one pass through a loader, and those of the mean measurement in every frame beside them.

    Args:
        loader: one loader; its data set may have ``names`` of scenes.
        metrics: by name.
        baseline: metrics of the mean measurement.
        every_n_frames: by metric: it looks at one in so many frames.
        device: on which scores are added up.

    Raises:
        BadInput: several loaders.
    """

    def __init__(
        self,
        loader: Any,
        metrics: Mapping[str, FrameMetric],
        baseline: Mapping[str, FrameMetric],
        every_n_frames: Mapping[str, int] | None,
        device: torch.device,
    ) -> None:
        if isinstance(loader, (Sequence, Mapping)):
            raise BadInput(f"validation and test take one loader, not {len(loader)}")
        names = getattr(getattr(loader, "dataset", None), "names", None)
        self.named = names is not None
        self.names = [UNNAMED] if names is None else list(names)
        self.device = device
        self.metrics = metrics
        self.scores = SceneScores(self.names, metrics, every_n_frames).to(device)
        self.baseline = SceneScores(self.names, baseline).to(device)
        self.seconds: list[float] = []

    def add(self, batch: Any, pipeline: Pipeline, tile: TileChoice | str) -> dict[str, torch.Tensor]:
        """Record, decode and score a batch.

        Returns:
            ``scene`` (N,), ``video`` and ``estimate`` (N, T, H, W) or in colour (N, 3, T, H, W), and the
            ``measurement`` (N, H, W) as recorded.

        Raises:
            BadInput: gray scenes before a Bayer sensor.
        """
        scenes, video, *taken = as_batch(batch, self.named)
        if pipeline.bayer is not None and video.ndim != 5:
            raise BadInput("encoder/sensor=bayer records scenes in colour, these are gray; data=folder reads colours")
        recorded, aperture = taken if taken else (pipeline.record(video), None)
        linear, mask = pipeline.linearise(recorded, aperture), pipeline.decoder_mask()
        start = self._now()
        estimate = pipeline.decode(linear, mask, tile)
        self.seconds.append((self._now() - start) / len(video))
        means = SnapshotOperator(mask).mean_video(linear)
        if pipeline.bayer is not None:
            estimate, means = (demosaiced(one, pipeline.bayer) for one in (estimate, means))
        for scene, decoded, mean, truth in zip(scenes.tolist(), estimate, means, video, strict=True):
            self.scores.update(int(scene), decoded, truth)
            self.baseline.update(int(scene), mean, truth)
        return {"scene": scenes, "video": video, "measurement": recorded, "estimate": estimate}

    def logged(self, name: str) -> tuple[dict[str, float], dict[str, Any]]:
        """Return the scores as a logger takes them, and as :class:`~sci_lightning.runs.results.RunMetrics` does.

        Args:
            name: ``val`` or ``test``: a mean is logged as ``val/psnr``, that of a scene as ``val_psnr/SCENE``.
        """
        scenes, mean = self.scores.compute()
        values = {f"{name}/{key}": value for key, value in mean.items()}
        values |= {f"{name}_{key}/{scene}": value for scene, row in scenes.items() for key, value in row.items()}
        return values, {
            "scenes": scenes,
            "mean": mean,
            "conventions": {key: metric.convention for key, metric in self.metrics.items() if metric.convention},
            "baseline": self.baseline.compute()[1],
            "seconds_per_measurement": statistics.median(self.seconds or [math.nan]),
            "device": device_name(self.device),
        }

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()


def build_metrics(settings: Mapping[str, Any], size: Sequence[int]) -> dict[str, FrameMetric]:
    """Build the metrics that ``metric=`` names, by their names in ``metrics.json``.

    Args:
        settings: the plain configuration of each metric by its name; one that is None is left out.
        size: (H, W) of the frames in pixels.

    Raises:
        BadInput: PSNR, by which the best checkpoint is chosen, is missing, an entry is no metric, or ``size`` is too
            small for it.
    """
    metrics = {
        name: as_frame_metric(name, build(metric, f"metrics.{name}")) for name, metric in settings.items() if metric
    }
    for name, metric in metrics.items():
        if min(size) < metric.smallest:
            raise BadInput(
                f"size={list(size)}: metrics.{name} needs frames of at least {metric.smallest} x {metric.smallest} "
                f"pixels; metrics.{name}=null leaves it out"
            )
    if "psnr" not in metrics:
        raise BadInput("metric: psnr is missing, which the best checkpoint is chosen by; add it, as in 'metric=[psnr]'")
    return metrics
