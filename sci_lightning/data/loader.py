"""Batches of training clips in an order that a resumed run continues, and batches of test scenes."""

from __future__ import annotations

import atexit
import signal
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from sci_lightning.data.source import Clips, Scene
from sci_lightning.errors import STOPS, BadInput


def share_of_batch(batch_size: int, processes: int) -> int:
    """Return how many of the clips of a step each process takes; of a batch of one, every process takes one.

    Raises:
        BadInput: the batch cannot be shared out evenly.
    """
    if batch_size == 1:
        return 1
    if batch_size % processes:
        raise BadInput(
            f"batch_size={batch_size} cannot be shared out to {processes} processes: give a multiple of {processes}, "
            "or another trainer.devices"
        )
    return batch_size // processes


class EpochSampler(Sampler[list[int]]):
    """The batches of one epoch of an endless stream of clips.

    Sample j of batch b on process r in epoch e is clip ``e * length + (b * world_size + r) * batch_size
    + j``. Only whole batches are drawn.

    Args:
        length: clips per epoch.
        batch_size: clips per batch on one process.
        rank: number of this process, among ``world_size``.

    Raises:
        BadInput: an epoch has no whole batch.
    """

    def __init__(self, length: int, batch_size: int, *, rank: int = 0, world_size: int = 1) -> None:
        self.length = length
        self.batch_size = batch_size
        self.rank = rank
        self.world_size = world_size
        self.epoch = 0
        self.first = (0, 0)
        if batch_size < 1 or length < batch_size * world_size:
            raise BadInput(
                f"batch_size={batch_size} on {world_size} process(es): an epoch of {length} clips has no "
                "whole batch; lower it or raise clips_per_epoch"
            )

    def __len__(self) -> int:
        """Return the number of batches per epoch."""
        return self.length // (self.batch_size * self.world_size)

    def __iter__(self) -> Iterator[list[int]]:
        start = self.first[1] if self.epoch == self.first[0] else 0
        for batch in range(start, len(self)):
            first = self.epoch * self.length + (batch * self.world_size + self.rank) * self.batch_size
            yield list(range(first, first + self.batch_size))

    @property
    def sampler(self) -> EpochSampler:
        """Itself: trainers look for ``loader.batch_sampler.sampler.set_epoch``."""
        return self

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch, from 0, of the next iteration."""
        self.epoch = epoch

    def start_at(self, epoch: int, batch: int) -> None:
        """Choose the epoch, from 0, of the next iteration; that epoch, and no other, begins at ``batch``."""
        self.epoch = epoch  # now, because workers load as soon as they are started
        self.first = (epoch, batch)


class ClipLoader(DataLoader[torch.Tensor]):
    """Training batches, float32 ``(batch_size, T, h, w)``; ``epoch_sampler.start_at`` continues an interrupted epoch.

    Worker processes compute on one thread each (PyTorch sees to that) and live on between epochs. They do not hear the
    signals that ask a program to stop: the training decides when it ends, and needs them for the step that it finishes.
    They end with the process that started them, however that ends.

    Args:
        clips: the endless stream.
        batch_size: clips per batch on this process.
        workers: processes that prepare batches; 0 prepares them in this one.
        rank: number of this process, among ``world_size``.
        pin_memory: see :class:`torch.utils.data.DataLoader`.

    Raises:
        BadInput: an epoch has no whole batch.
    """

    def __init__(
        self,
        clips: Clips,
        batch_size: int,
        *,
        workers: int = 0,
        rank: int = 0,
        world_size: int = 1,
        pin_memory: bool = False,
    ) -> None:
        sampler = EpochSampler(len(clips), batch_size, rank=rank, world_size=world_size)
        super().__init__(
            clips,
            batch_sampler=sampler,
            num_workers=workers,
            persistent_workers=workers > 0,
            pin_memory=pin_memory,
        )
        self.epoch_sampler = sampler

    def __iter__(self) -> Any:
        # a process inherits what is blocked where it is started, so that no moment is left in which a signal ends it
        before, running = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS), self._iterator
        try:
            iterator = super().__iter__()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if self.num_workers and iterator is not running:  # Python would wait for them at its exit, and they for it
            atexit.register(_end_workers, weakref.ref(iterator))
        return iterator


def _end_workers(reference: Callable[[], Any]) -> None:
    """Ask the workers of an iterator to end, if it is still there."""
    if (iterator := reference()) is not None:
        iterator._shutdown_workers()


class SceneSnapshots(Dataset[tuple[int, torch.Tensor]]):
    """Single snapshots of scenes, in order: ``(scene's number, video (T, H, W))``.

    Args:
        scenes: scenes to cut into snapshots.
        rank: number of this process, which gets every ``world_size``-th snapshot.
    """

    def __init__(self, scenes: Sequence[Scene], *, rank: int = 0, world_size: int = 1) -> None:
        self.scenes = scenes
        every = [(s, n) for s, scene in enumerate(scenes) for n in range(len(scene.video))]
        self.places = every[rank::world_size]

    @property
    def names(self) -> list[str]:
        """Names of the scenes, by number."""
        return [scene.name for scene in self.scenes]

    def first(self, scene: int) -> torch.Tensor:
        """Return the first snapshot ``(T, H, W)`` of scene number ``scene``, on every process."""
        return self.scenes[scene].video[0]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> tuple[int, torch.Tensor]:
        scene, snapshot = self.places[index]
        return scene, self.scenes[scene].video[snapshot]


def scene_loader(
    scenes: Sequence[Scene], batch_size: int = 1, *, rank: int = 0, world_size: int = 1
) -> DataLoader[tuple[int, torch.Tensor]]:
    """Return a loader of :class:`SceneSnapshots` in batches ``(scene numbers (B,), video (B, T, H, W))``."""
    return DataLoader(SceneSnapshots(scenes, rank=rank, world_size=world_size), batch_size=batch_size)
