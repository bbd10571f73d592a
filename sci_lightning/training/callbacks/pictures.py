"""Pictures of mask and reconstructions: during a training, in the dashboard and the run's folder, and of a test."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from matplotlib.figure import Figure

from sci_lightning.data.loader import SceneSnapshots
from sci_lightning.figures.figure import mask_figure, pair_figure, reconstruction_figure, write_figure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.plain_text import file_name
from sci_lightning.training.scored_pipeline import ScoredPipeline
from sci_lightning.training.system import System

CORNER = 24
"""Side in pixels of the part of a slot whose single pixels can be made out on a dashboard."""


DRAWING_SHARE = 0.1
"""Part of a training's time that drawing may take: with short epochs it would otherwise take most of it."""


class Pictures(L.Callback):
    """Draws the mask before the first step, and mask and reconstructions of some scenes after validations.

    Validations that follow each other so closely that drawing would take more than :data:`DRAWING_SHARE` of the time
    are passed over; the last one is always drawn.

    TensorBoard gets a series of two images side by side, large enough for its cards; ``folder`` has PNG files of the
    latest state with all slots and frames.

    Args:
        folder: the folder of the PNG files, created when needed.
        scenes: number of scenes, of which the first snapshot is shown.
    """

    def __init__(self, folder: str, scenes: int = 2) -> None:
        self.folder = Path(folder)
        self.scenes = scenes
        self._due = 0.0  # on the monotonic clock
        self._is_drawn = True

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if trainer.is_global_zero and trainer.global_step == 0 and isinstance(pl_module, System):
            self._show(trainer, [self._mask(trainer, pl_module)])

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not trainer.is_global_zero or trainer.sanity_checking or not isinstance(pl_module, System):
            return
        self._is_drawn = (begun := time.monotonic()) >= self._due
        if self._is_drawn:
            self._show(trainer, self._figures(trainer, pl_module))
            self._due = time.monotonic() + (time.monotonic() - begun) / DRAWING_SHARE

    def on_fit_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not self._is_drawn:
            self._due = 0.0
            self.on_validation_end(trainer, pl_module)

    def _show(self, trainer: L.Trainer, drawn: Iterable[tuple[str, Figure, Figure]]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        boards = [logger.experiment for logger in trainer.loggers if isinstance(logger, TensorBoardLogger)]
        for name, figure, card in drawn:
            with atomic_write(self.folder / f"{name.replace('/', '_')}.png") as temporary:  # never through a link
                figure.savefig(temporary, dpi=110, format="png")
            for board in boards:
                board.add_figure(name, card, trainer.global_step)

    @torch.no_grad()
    def _mask(self, trainer: L.Trainer, system: System) -> tuple[str, Figure, Figure]:
        mask, bits = system.encoder.mask(), getattr(system.encoder.mask, "bits", None)
        depth = "" if bits is None else f", {bits} bit{'s' * (bits > 1)}"
        name = system.run_config.get("names", {}).get("encoder", "mask")
        title = f"{name}{depth}, step {trainer.global_step}"
        corner = mask[:, :CORNER, :CORNER]
        card = pair_figure(("slot 1, corner", corner[0]), (f"slot {len(mask)}, corner", corner[-1]), title)
        return "mask", mask_figure(mask, bits, title), card

    @torch.no_grad()
    def _figures(self, trainer: L.Trainer, system: System) -> Iterator[tuple[str, Figure, Figure]]:
        yield self._mask(trainer, system)
        pipeline = system.pipeline
        snapshots = getattr(trainer.val_dataloaders, "dataset", None)
        if not isinstance(snapshots, SceneSnapshots):  # of a loader of somebody's own, whose order may change
            return
        first = [snapshots.first(scene) for scene in range(min(self.scenes, len(snapshots.names)))]
        for name, video in zip(snapshots.names, first, strict=False):
            video = video.to(system.device).unsqueeze(0)
            measurement = pipeline.record(video)
            estimate = pipeline.decode(pipeline.linearise(measurement), pipeline.decoder_mask())
            middle = video.shape[1] // 2
            card = pair_figure((f"frame {middle + 1}", video[0, middle]), ("reconstruction", estimate[0, middle]), name)
            yield f"scene/{name}", reconstruction_figure(measurement[0], video[0], estimate[0], name), card


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
        if not trainer.is_global_zero or not isinstance(pl_module, ScoredPipeline) or pl_module.scoring is None:
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
