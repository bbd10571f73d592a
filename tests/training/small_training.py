"""A training as small as one can be, which may be killed at any moment, and what it must end with."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch

from sci_lightning.data import Clips, Scene
from sci_lightning.data.loader import ClipLoader, scene_loader
from sci_lightning.decoder import Decoder
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.metrics import PSNR
from sci_lightning.training.callbacks import BestCheckpoint, LastCheckpoint
from sci_lightning.training.stop_signal import SAME_REQUEST_SECONDS
from sci_lightning.training.system import System
from sci_lightning.training.training_checkpoint import TrainingCheckpointIO

TINY = [
    "size=[32,32]",
    "batch_size=2",
    "workers=0",
    "decoder=e2e_cnn",
    "decoder.channels=8",
    "decoder.blocks=1",
    "data.clips_per_epoch=8",
    "trainer.max_epochs=2",
    "trainer.accelerator=cpu",
    "trainer.log_every_n_steps=1",
]
"""The command train with the smallest of everything."""

BATCHES, EPOCHS = 5, 3


class Small(Decoder):
    """As small as a decoder can be."""

    def __init__(self) -> None:
        super().__init__()
        self.net = torch.nn.Conv2d(2, 2, 1)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.net(mask * measurement.unsqueeze(1))


class Noise(Clips):
    """Clips of noise, larger numbers being brighter."""

    def __len__(self) -> int:
        return BATCHES

    def __getitem__(self, index: int) -> torch.Tensor:
        return torch.rand(2, 4, 4, generator=torch.Generator().manual_seed(index)) / (1 + index % 7)


class Kill(BaseException):
    """The end of a process that had no time to clean up."""


class Killer(L.Callback):
    """Ends a training at a step: before its checkpoint, after it, or in the middle of the validation that follows."""

    def __init__(self, step: int | None, moment: str) -> None:
        self.step, self.moment = step, moment
        self.batches: list[float] = []

    def _at(self, trainer: L.Trainer, moment: str) -> None:
        if trainer.global_step == self.step and self.moment == moment and not trainer.sanity_checking:
            raise Kill

    def on_train_batch_end(self, trainer: L.Trainer, *others: Any) -> None:
        self._at(trainer, "before the checkpoint")

    def on_train_batch_start(self, trainer: L.Trainer, *others: Any) -> None:
        self.batches.append(float(others[1].sum()))
        self._at(trainer, "after the checkpoint")

    def on_validation_batch_end(self, trainer: L.Trainer, *others: Any) -> None:
        self._at(trainer, "in validation")

    def on_train_epoch_end(self, trainer: L.Trainer, *others: Any) -> None:
        self._at(trainer, "after the epoch")


MOMENTS = ("before the checkpoint", "after the checkpoint", "in validation", "after the epoch")


def system_and_trainer(
    folder: Path,
    callbacks: Sequence[L.Callback] = (),
    every: int = 2,
    workers: int = 0,
    decoder: Decoder | None = None,
    lr: float = 1e-2,
    muon_lr: float | None = None,
    warmup: float = 0.0,
    cuda_graph: bool = False,
    **options: Any,
) -> tuple[System, L.Trainer, ClipLoader]:
    torch.manual_seed(0)
    system = System(
        Encoder(LearnedStructural(2, 2, (4, 4)), ClipQuantise(8, read_noise=1.0)),
        decoder or Small(),
        metrics={"psnr": PSNR()},
        lr=lr,
        muon_lr=muon_lr,
        warmup=warmup,
        cuda_graph=cuda_graph,
    )
    clips = ClipLoader(Noise(), 1, workers=workers)
    last = LastCheckpoint(folder, every_minutes=None, every_n_steps=every)
    options = {"max_epochs": EPOCHS, **options}
    trainer = L.Trainer(
        callbacks=[last, BestCheckpoint(folder), *callbacks],
        plugins=[TrainingCheckpointIO(system, clips)],
        accelerator="cpu",
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,
        **options,
    )
    return system, trainer, clips


def scenes() -> Any:
    """Held-out noise."""
    return scene_loader([Scene("noise", torch.rand(2, 2, 4, 4, generator=torch.Generator().manual_seed(1)))])


def train(folder: Path, step: int | None = None, moment: str = MOMENTS[1], **options: Any) -> dict[str, Any] | None:
    """Go on with what lies in a folder; the final checkpoint, or None if the training was killed."""
    last, killer = folder / "last.ckpt", Killer(step, moment)
    system, trainer, clips = system_and_trainer(folder, [killer], **options)
    try:
        trainer.fit(system, clips, scenes(), ckpt_path=str(last) if last.is_file() else None)
    except Kill:
        return None
    trainer.save_checkpoint(last)
    return {**torch.load(last, weights_only=True), "batches": killer.batches}


def same(one: Any, other: Any) -> bool:
    """Whether two checkpoints' contents are equal to the bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else bool(one == other)


def check_chain(folder: Path, uninterrupted: dict[str, Any], kills: Sequence[tuple[int, str]], **options: Any) -> None:
    for step, moment in kills:
        train(folder, step, moment, **options)
    ended = train(folder, **options)
    assert ended is not None
    for key in ("global_step", "state_dict", "optimizer_states", "lr_schedulers", "position"):
        assert same(ended[key], uninterrupted[key]), f"{key} differs after {kills} with {options}"
    best = [torch.load(path / "best.ckpt", weights_only=True) for path in (folder, folder.parent / "whole")]
    assert same(best[0]["state_dict"], best[1]["state_dict"]), f"best.ckpt differs after {kills} with {options}"


class Sender(L.Callback):
    """Sends this process a signal once a moment has come: as somebody at the keyboard, only never too late."""

    def __init__(self, number: int, moment: str, step: int = 3, times: int = 1, group: bool = False) -> None:
        self.number, self.moment, self.step, self.times = number, moment, step, times
        self.receiver = 0 if group else os.getpid()

    def _at(self, trainer: L.Trainer, moment: str) -> None:
        if moment == self.moment and trainer.global_step >= self.step:
            self.moment = ""  # once
            for _ in range(self.times):
                os.kill(self.receiver, self.number)
                time.sleep(1.1 * SAME_REQUEST_SECONDS if self.times > 1 else 0)

    def on_fit_start(self, trainer: L.Trainer, *others: object) -> None:
        self._at(trainer, "start")

    def on_train_batch_start(self, trainer: L.Trainer, *others: object) -> None:
        self._at(trainer, "batch")

    def on_validation_batch_start(self, trainer: L.Trainer, *others: object) -> None:
        self._at(trainer, "validation")

    def on_test_batch_start(self, trainer: L.Trainer, *others: object) -> None:
        self._at(trainer, "test")
