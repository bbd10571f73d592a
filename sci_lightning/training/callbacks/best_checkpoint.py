"""``checkpoints/best.ckpt``: the weights with the best validation metric."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Checkpoint


class BestCheckpoint(Checkpoint):
    """Writes ``best.ckpt`` after every validation that is better than all before it.

    Its state is the best value, never a path: a resumed training compares with it as long as ``best.ckpt`` exists.

    Args:
        folder: the folder in which it is written.
        monitor: the logged metric; larger is better.
    """

    def __init__(self, folder: str | Path, monitor: str = "val/psnr") -> None:
        self.path = Path(folder) / "best.ckpt"
        self.monitor = monitor
        self.best = -math.inf

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not trainer.strategy.broadcast(self.path.is_file()):
            self.best = -math.inf

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        value = trainer.callback_metrics.get(self.monitor)
        if value is None or trainer.sanity_checking or trainer.state.fn != "fit" or not float(value) > self.best:
            return
        self.best = float(value)
        trainer.save_checkpoint(self.path)

    def state_dict(self) -> dict[str, Any]:
        return {"best": self.best} if math.isfinite(self.best) else {}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.best = float(state_dict["best"])
