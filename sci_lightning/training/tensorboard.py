"""The TensorBoard log of a training: what matters first, and the curves of all runs in the same charts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lightning.pytorch.loggers import TensorBoardLogger as LightningTensorBoardLogger

CURVES = {"train/loss": "curves/loss", "val/psnr": "curves/psnr"}
"""What is shown first, and under which tag: TensorBoard sorts groups by name and opens the first two, which are
``curves`` and ``mask``. The tags name no encoder and no bit depth, so that the runs of a sweep share a chart."""


class TensorBoardLogger(LightningTensorBoardLogger):
    """Lightning's logger, with loss and PSNR repeated in a group of charts that TensorBoard shows first.

    The number of the epoch, which Lightning adds to everything that is logged, is left out.
    """

    def log_metrics(self, metrics: Mapping[str, Any], step: int | None = None) -> None:
        values = {tag: value for tag, value in metrics.items() if tag != "epoch"}
        super().log_metrics(values | {CURVES[tag]: value for tag, value in values.items() if tag in CURVES}, step)
