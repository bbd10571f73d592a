"""The progress bar."""

from __future__ import annotations

from typing import Any

import lightning as L
from lightning.pytorch.callbacks import RichProgressBar

from sci_lightning.decoder.iterative import Iteration, Iterative


class Progress(RichProgressBar):
    """Lightning's Rich progress bar with loss and PSNR, without the logger's version number.

    In a test it shows how far a decoder that iterates is, and the residual.
    """

    def get_metrics(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, Any]:
        metrics = super().get_metrics(trainer, pl_module)
        return {name: value for name, value in metrics.items() if name != "v_num"}

    def on_test_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_test_start(trainer, pl_module)
        if isinstance(decoder := pl_module.decoder, Iterative) and self.is_enabled:
            decoder.watch = self._show

    def on_test_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_test_end(trainer, pl_module)
        if isinstance(decoder := pl_module.decoder, Iterative):
            decoder.watch = None

    def _show(self, iteration: Iteration) -> None:
        if self.progress is not None and self.test_progress_bar_id is not None:
            self.progress.update(self.test_progress_bar_id, description=f"{self.test_description}: {iteration}")
            self.refresh()
