"""Pictures of the scenes of a test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import lightning as L

from sci_lightning.figures.figure import reconstruction_figure, write_figure
from sci_lightning.plain_text import file_name
from sci_lightning.training.system import System


class ScenePictures(L.Callback):
    """Writes the first snapshot of every scene of a test: measurement, frames, their reconstruction and the error.

    Args:
        folder: the folder of ``<scene>.png``, created when needed.
        camera: decoder and encoder in words, for the heading beside the scene's name.
        most: largest number of scenes of which pictures are written.
    """

    def __init__(self, folder: str | Path, camera: str = "", most: int = 24) -> None:
        self.folder = Path(folder)
        self.camera = camera
        self.most = most
        self.written: dict[int, Path] = {}

    def on_test_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.written = {}

    def on_test_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        if not trainer.is_global_zero or not isinstance(pl_module, System) or pl_module.scoring is None:
            return
        for index, scene in enumerate(map(int, outputs["scene"])):
            if scene not in self.written and len(self.written) < self.most:
                name = pl_module.scoring.names[scene]
                title = f"{name}, {self.camera}" if self.camera else name
                pictures = (outputs["measurement"][index], outputs["video"][index], outputs["estimate"][index])
                self.written[scene] = self._path(name)
                write_figure(reconstruction_figure(*pictures, title), self.written[scene])

    def _path(self, name: str) -> Path:
        """Return a path for a scene of this name that no other scene has."""
        stem, number = file_name(name), 1
        path = self.folder / f"{stem}.png"
        while path in self.written.values():
            number += 1
            path = self.folder / f"{stem}_{number}.png"
        return path
