"""Pictures of mask and reconstructions during a training, in the dashboard and in the run's folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import lightning as L
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from matplotlib.figure import Figure

from sci_lightning.data.loader import SceneSnapshots
from sci_lightning.figures.figure import mask_figure, pair_figure, reconstruction_figure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.training.system import System

CORNER = 24
"""Side in pixels of the part of a slot whose single pixels can be made out on a dashboard."""


class Pictures(L.Callback):
    """Draws the mask before the first step, and mask and reconstructions of some scenes after every validation.

    TensorBoard gets a series of two images side by side, large enough for its cards; ``folder`` has PNG files of the
    latest state with all slots and frames.

    Args:
        folder: the folder of the PNG files, created when needed.
        scenes: number of scenes, of which the first snapshot is shown.
    """

    def __init__(self, folder: str, scenes: int = 2) -> None:
        self.folder = Path(folder)
        self.scenes = scenes

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if trainer.is_global_zero and trainer.global_step == 0 and isinstance(pl_module, System):
            self._show(trainer, [self._mask(trainer, pl_module)])

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not trainer.is_global_zero or trainer.sanity_checking or not isinstance(pl_module, System):
            return
        self._show(trainer, self._figures(trainer, pl_module))

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
