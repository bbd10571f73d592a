"""The progress bar, and the speed of a training."""

from __future__ import annotations

import time
from typing import Any, cast

import lightning as L
from lightning.pytorch.callbacks import RichProgressBar
from torch import nn

from sci_lightning.decoder import Decoder
from sci_lightning.training.scoring import as_clips

PATIENCE = 2.0
"""Seconds within a batch after which the bar moves with its layers."""


class Progress(RichProgressBar):
    """Lightning's Rich progress bar with loss and PSNR, without the logger's version number.

    In a test it shows the tile of a large snapshot, and how far its decoder is. A file,
    such as the log of a job, cannot show a bar: a training writes a line every ``line_seconds`` and after every
    validation instead. Within a step that takes longer than a few seconds the bar moves with the decoder's layers.

    Args:
        line_seconds: seconds between two lines in a file.
    """

    def __init__(self, line_seconds: float = 10.0) -> None:
        super().__init__()
        self.line_seconds = line_seconds
        self._last_line = time.monotonic()
        self._hooks: list[Any] = []
        self._done = self._of = 0
        self._shown = self._batch_begun = 0.0

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Watch the layers of the decoder, whose gradients come last; Lightning's own bars begin after this."""
        super().on_fit_start(trainer, pl_module)
        self._batch_begun = time.monotonic()
        decoder = cast(nn.Module, pl_module.decoder)
        if trainer.strategy.root_device.type != "cpu" or pl_module.hparams.get("compile"):
            return
        layers = [module for module in decoder.modules() if next(module.parameters(False), None) is not None]
        learned = [parameter for parameter in decoder.parameters() if parameter.requires_grad]
        self._of = len(layers) + 2 * len(learned)  # the backward pass takes twice as long

        def passed(weight: int) -> None:
            self._done += weight
            now = time.monotonic()
            if now - self._batch_begun > PATIENCE and now - self._shown > PATIENCE:
                self._shown = now
                self._show_part(trainer, pl_module)

        self._hooks = [layer.register_forward_hook(lambda *_: passed(1)) for layer in layers]
        self._hooks += [p.register_post_accumulate_grad_hook(lambda _: passed(2)) for p in learned]

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        for hook in self._hooks:
            hook.remove()
        self._hooks = []

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        super().on_train_batch_start(trainer, pl_module, batch, batch_idx)
        self._done, self._batch_begun = 0, time.monotonic()

    def on_validation_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int, dataloader_idx: int = 0
    ) -> None:
        super().on_validation_batch_start(trainer, pl_module, batch, batch_idx, dataloader_idx)
        self._done, self._batch_begun = 0, time.monotonic()

    def _show_part(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Move the bar by the part of a batch that is computed."""
        if self.progress is None:
            return
        training = trainer.training
        weights = len(list(cast(nn.Module, pl_module.decoder).parameters()))
        of = self._of if training else max(1, self._of - 2 * weights)
        part = min(0.99, self._done / of)
        bar = self.train_progress_bar_id if training else self.val_progress_bar_id
        if not self.progress.console.is_terminal:
            if time.monotonic() - self._last_line >= self.line_seconds:
                self._write_line(trainer, pl_module, f", {self._in_words(part, training)}")
        elif bar is not None:
            loop = trainer.fit_loop.epoch_loop
            batch = loop.batch_idx if training else loop.val_loop.batch_progress.current.completed
            name = next(task.description for task in self.progress.tasks if task.id == bar).partition(" · ")[0]
            words = self._in_words(part, training)
            self.progress.update(bar, completed=batch + part, description=f"{name} · {words}")
            self.refresh()

    def _in_words(self, part: float, training: bool) -> str:
        return f"{part:.0%} of this {'step' if training else 'validation snapshot'} computed"

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
        if isinstance(decoder := pl_module.decoder, Decoder) and self.is_enabled:
            decoder.watch = self._show

    def on_test_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_test_end(trainer, pl_module)
        if isinstance(decoder := pl_module.decoder, Decoder):
            decoder.watch = None

    def _write_line(self, trainer: L.Trainer, pl_module: L.LightningModule, more: str = "") -> None:
        """Write epoch, step and metrics in one line, unless a terminal shows the bar."""
        if self.progress is None or self.progress.console.is_terminal:
            return
        self._last_line = time.monotonic()
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.get_metrics(trainer, pl_module).items())
        self.progress.console.print(f"epoch {trainer.current_epoch}, step {trainer.global_step}{more}: {values}")

    def show_tile(self, tile: int, of: int) -> None:
        """Show which tile of a snapshot has been decoded."""
        self._show(f"tile {tile} of {of}")

    def _show(self, state: object) -> None:
        if self.progress is not None and self.test_progress_bar_id is not None:
            self.progress.update(self.test_progress_bar_id, description=f"{self.test_description}: {state}")
            self.refresh()


class Throughput(L.Callback):
    """Logs ``train/clips_per_second`` and ``train/loading_share`` every so many batches, as means over them.

    Clips are counted over all processes; the loading share is the part of the time spent waiting for data.

    Args:
        every_n_steps: batches between two logs; 0 for none.
    """

    def __init__(self, every_n_steps: int = 10) -> None:
        self.every_n_steps = every_n_steps
        self._restart()
        self._ended = 0.0

    def _restart(self) -> None:
        self._clips = 0
        self._busy = 0.0
        self._waited = 0.0

    def on_train_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._ended = time.perf_counter()

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        self._started = time.perf_counter()
        self._waited += self._started - self._ended

    def on_train_batch_end(
        self, trainer: L.Trainer, pl_module: L.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        self._ended = time.perf_counter()
        self._busy += self._ended - self._started
        self._clips += len(as_clips(batch)) * trainer.world_size
        if self.every_n_steps and (trainer.fit_loop.total_batch_idx + 1) % self.every_n_steps == 0:
            total = self._busy + self._waited
            pl_module.log("train/clips_per_second", self._clips / total)
            pl_module.log("train/loading_share", self._waited / total)
            self._restart()

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._paused = time.perf_counter()

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self._ended += time.perf_counter() - self._paused  # time in validation is not spent waiting for data
