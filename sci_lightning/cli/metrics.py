"""What a run is scored with."""

from __future__ import annotations

from omegaconf import DictConfig

from sci_lightning.cli.command import built
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import with_article
from sci_lightning.metrics.frame_metric import FrameMetric


def chosen_metrics(cfg: DictConfig) -> dict[str, FrameMetric]:
    """The metrics that ``metric=`` names, by their names in ``metrics.json``.

    Args:
        cfg: of the command; an entry of ``metrics`` that is None is left out.

    Raises:
        BadInput: PSNR, by which the best checkpoint is chosen, is missing, an entry is no metric, or ``size`` is too
            small for it.
    """
    metrics = {str(name): built(cfg, f"metrics.{name}") for name, metric in cfg.get("metrics", {}).items() if metric}
    for name, metric in metrics.items():
        if not isinstance(metric, FrameMetric):
            raise BadInput(f"metrics.{name}: its _target_ is {with_article(type(metric).__name__)}, not a FrameMetric")
        if min(cfg.size) < metric.smallest:
            raise BadInput(
                f"size={list(cfg.size)}: metrics.{name} needs frames of at least {metric.smallest} x {metric.smallest} "
                f"pixels; metrics.{name}=null leaves it out"
            )
    if "psnr" not in metrics:
        raise BadInput("metric: psnr is missing, which the best checkpoint is chosen by; add it, as in metric=[psnr]")
    return metrics
