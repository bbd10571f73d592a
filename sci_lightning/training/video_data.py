"""The LightningDataModule: clips to train on, scenes to validate and to test on."""

from __future__ import annotations

from typing import Any

import lightning as L

from sci_lightning.configuration.bounds import Repeats
from sci_lightning.data.loader import ClipLoader, scene_loader, share_of_batch
from sci_lightning.data.source import Source


class VideoData(L.LightningDataModule):
    """A source of video as Lightning takes it: ``trainer.fit(system, data)``, ``trainer.test(system, data)``.

    The loaders share their clips out to the processes of a training themselves: on several devices give the trainer
    ``use_distributed_sampler=False``.

    Args:
        source: clips of training and held-out scenes of validation and test.
        batch_size: clips of a step, of all processes together.
        workers: processes that prepare clips; 0 prepares them in this one.
        test: the scenes of the test come from there; None for ``source``.

    Raises:
        BadInput: a batch that cannot be shared out, or an epoch without a whole batch.
    """

    def __init__(
        self, source: Source, batch_size: Repeats = 1, workers: int = 0, *, test: Source | None = None
    ) -> None:
        super().__init__()
        self.save_hyperparameters("batch_size", "workers")
        self.source = source
        self.batch_size, self.workers = batch_size, workers
        self.held_out = source.scenes()
        self.tested = self.held_out if test is None else test.scenes()
        self._clips: ClipLoader | None = None

    def train_dataloader(self) -> ClipLoader:
        """Return the loader of clips, always the same: a training that goes on sets its place."""
        if self._clips is None:
            on_gpu = self.trainer is not None and self.trainer.strategy.root_device.type == "cuda"
            share = self._share()
            size = share_of_batch(self.batch_size, share["world_size"])
            self._clips = ClipLoader(self.source.clips(), size, workers=self.workers, pin_memory=on_gpu, **share)
        return self._clips

    def val_dataloader(self) -> Any:
        """Return a loader of the held-out scenes' snapshots."""
        return scene_loader(self.held_out, **self._share())

    def test_dataloader(self) -> Any:
        """Return a loader of the test scenes' snapshots."""
        return scene_loader(self.tested, **self._share())

    def _share(self) -> dict[str, int]:
        if self.trainer is None:
            return {"rank": 0, "world_size": 1}
        return {"rank": self.trainer.global_rank, "world_size": self.trainer.world_size}
