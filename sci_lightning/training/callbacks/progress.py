"""The progress bar."""

from __future__ import annotations

import time
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import RichProgressBar

from sci_lightning.decoder.iterative import Iteration, Iterative


class Progress(RichProgressBar):
    """Lightning's Rich progress bar with loss and PSNR, without the logger's version number.

    In a test it shows the tile of a large snapshot, and the iteration and the residual of an iterative decoder. A file,
    such as the log of a job, cannot show a bar: a training writes a line every ``line_seconds`` and after every
    validation instead.

    Args:
        line_seconds: seconds between two lines in a file.
    """

    def __init__(self, line_seconds: float = 15.0) -> None:
        super().__init__()
        self.line_seconds = line_seconds
        self._last_line = time.monotonic()

    def get_metrics(self, trainer: L.Trainer, pl_module: L.LightningModule) -> dict[str, Any]:
        metrics = super().get_metrics(trainer, pl_module)
        return {name: value for name, value in metrics.items() if name != "v_num"}

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)
        if time.monotonic() - self._last_line >= self.line_seconds:
            self._write_line(trainer, pl_module)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_validation_end(trainer, pl_module)
        if trainer.state.fn == "fit" and not trainer.sanity_checking:
            self._write_line(trainer, pl_module)

    def on_test_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_test_start(trainer, pl_module)
        if isinstance(decoder := pl_module.decoder, Iterative) and self.is_enabled:
            decoder.watch = self._show

    def on_test_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_test_end(trainer, pl_module)
        if isinstance(decoder := pl_module.decoder, Iterative):
            decoder.watch = None

    def _write_line(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Write epoch, step and metrics in one line, unless a terminal shows the bar."""
        if self.progress is None or self.progress.console.is_terminal:
            return
        self._last_line = time.monotonic()
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.get_metrics(trainer, pl_module).items())
        self.progress.console.print(f"epoch {trainer.current_epoch}, step {trainer.global_step}: {values}")

    def show_tile(self, tile: int, of: int) -> None:
        """Show which tile of a snapshot has been decoded."""
        self._show(f"tile {tile} of {of}")

    def _show(self, iteration: Iteration | str) -> None:
        if self.progress is not None and self.test_progress_bar_id is not None:
            self.progress.update(self.test_progress_bar_id, description=f"{self.test_description}: {iteration}")
            self.refresh()
