"""The metrics that a run is measured with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput
from sci_lightning.metrics.frame_metric import FrameMetric, as_frame_metric


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
