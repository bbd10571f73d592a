"""Resuming from a checkpoint: a training takes checked numbers and tensors from the file, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.fabric.plugins.io.torch_io import TorchCheckpointIO
from lightning.pytorch.callbacks import Timer

from sci_lightning.data.loader import ClipLoader
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import load_file, write_checkpoint
from sci_lightning.training.system import System
from sci_lightning.training.training_position import TrainingPosition

SCALER = "MixedPrecision"
"""The key under which Lightning keeps the gradient scaler's state of ``trainer.precision=16-mixed``."""

SCALER_NUMBERS = {"scale", "growth_factor", "backoff_factor", "growth_interval", "_growth_tracker"}

ADAM_TENSORS = {"step", "exp_avg", "exp_avg_sq"}

MUON_TENSORS = {"step", "momentum_buffer"}


class TrainingCheckpointIO(TorchCheckpointIO):
    """Lightning's file access in a training: the only way from a checkpoint into the trainer.

    Lightning trusts what it reads: it would remove the files that a checkpoint calls the previous best ones, set any
    attribute of its schedulers and any count of its loops. Therefore it gets a new dictionary, built here. Everything
    that does not change during a training comes from the present training. From the file come the weights, the
    optimizer's tensors and learning rates, the number of steps, the gradient scaler's numbers, and those states of
    callbacks that hold numbers and tensors only (text could be a path).

    Args:
        system: the system that is trained.
        clips: its training data, which is set to the batch to continue with; None for those of the trainer's
            :class:`~sci_lightning.training.video_data.VideoData`.
    """

    def __init__(self, system: System, clips: ClipLoader | None = None) -> None:
        super().__init__()
        self.system = system
        self.clips = clips
        self._prepared: tuple[str, dict[str, Any]] | None = None

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        checkpoint.pop("loops", None)  # follows from the position
        write_checkpoint(path, checkpoint)

    def prepare(self, path: str | Path) -> None:
        """Read a checkpoint before the trainer does, so that one that is refused is refused before anything is written.

        Raises:
            BadInput: as :meth:`load_checkpoint`.
        """
        self._prepared = str(path), self.load_checkpoint(path)

    def load_checkpoint(self, path: Any, map_location: Any = None, weights_only: bool | None = None) -> dict[str, Any]:
        """Read a checkpoint, or return the one that was prepared.

        Raises:
            BadInput: something in it is not as a training of this system writes it.
            ValueError: there is no training data.
        """
        prepared, self._prepared = self._prepared, None
        if prepared is not None and prepared[0] == str(path):
            return prepared[1]
        content = load_file(Path(path))
        trainer = self.system.trainer
        data = getattr(trainer, "datamodule", None)
        clips = data.train_dataloader() if self.clips is None and data is not None else self.clips
        if not isinstance(clips, ClipLoader):
            raise ValueError("give clips, or the trainer a VideoData, before a checkpoint is read")
        batches, limit = len(clips.epoch_sampler), trainer.limit_train_batches
        batches = min(batches, limit) if isinstance(limit, int) else int(batches * limit)
        position = TrainingPosition.read(path, content, batches)
        position.check_plan(path, trainer)
        clips.epoch_sampler.start_at(*position.place(trainer.accumulate_grad_batches))
        optimizer, scheduler = self._training_state(path, content, position.steps)
        _restore_callbacks(path, content.get("callbacks"), trainer)
        state = {
            "pytorch-lightning_version": L.__version__,
            "epoch": position.place(trainer.accumulate_grad_batches)[0],
            "global_step": position.steps,
            "state_dict": self._weights(path, content.get("state_dict")),
            "loops": position.loops(trainer),
            "optimizer_states": [optimizer],
            "lr_schedulers": [scheduler],
            "callbacks": {},
        }
        if (scaler := content.get(SCALER)) is not None:
            numbers = isinstance(scaler, dict) and all(map(_is_number, scaler.values()))
            if not numbers or scaler.keys() != SCALER_NUMBERS:
                raise _damaged(path, "its gradient scaler's state")
            state[SCALER] = scaler
        return state

    def _weights(self, path: Any, state: Any) -> dict[str, torch.Tensor]:
        wanted = self.system.state_dict()
        if not isinstance(state, dict) or state.keys() != wanted.keys():
            raise _damaged(path, "its weights")
        if any(not _like(state[key], value.shape) for key, value in wanted.items()):
            raise _damaged(path, "its weights")
        return state

    def _training_state(self, path: Any, content: Mapping[str, Any], steps: int) -> tuple[dict[str, Any], Any]:
        """Return the states of a new optimizer and scheduler, with the file's tensors and learning rates in them."""
        fresh = self.system.configure_optimizers()
        optimizer, scheduler = fresh["optimizer"], fresh["lr_scheduler"]["scheduler"]
        parameters = [(p, group.get("muon")) for group in optimizer.param_groups for p in group["params"]]
        try:
            (saved,) = content["optimizer_states"]
            tensors, rates = saved["state"], [group["lr"] for group in saved["param_groups"]]
            right = len(rates) == len(optimizer.param_groups) and all(_is_number(rate) and rate >= 0 for rate in rates)
            for index, entries in tensors.items():
                parameter, is_muon = parameters[index]
                right &= type(index) is int and index >= 0
                right &= entries.keys() == (MUON_TENSORS if is_muon else ADAM_TENSORS)
                right &= all(_like(value, ()) or _like(value, parameter.shape) for value in entries.values())
        except (TypeError, ValueError, KeyError, IndexError, AttributeError) as error:
            raise _damaged(path, "its optimizer's state") from error
        if not right:
            raise _damaged(path, "its optimizer's state")
        groups = [{**group, "lr": r} for group, r in zip(optimizer.state_dict()["param_groups"], rates, strict=True)]
        schedule = {**scheduler.state_dict(), "last_epoch": steps, "_step_count": steps + 1, "_last_lr": rates}
        return {"state": tensors, "param_groups": groups}, schedule


def _restore_callbacks(path: Any, states: Any, trainer: L.Trainer) -> None:
    """Load every callback's state if it holds numbers and tensors only; others are left out."""
    if states is not None and not isinstance(states, dict):
        raise _damaged(path, "the states of its callbacks")
    for callback in trainer.callbacks:  # type: ignore[attr-defined]  # set by Lightning, not declared
        state = (states or {}).get(callback.state_key)
        if not isinstance(state, dict) or not _is_plain(state):
            continue
        try:
            if isinstance(callback, Timer) and not _is_number(state["time_elapsed"]["train"]):
                raise TypeError("no time")
            callback.load_state_dict(state)
        except Exception as error:  # whatever a callback makes of numbers that it does not expect
            raise _damaged(path, f"the state of its {type(callback).__name__}") from error


def _is_plain(value: Any) -> bool:
    """Return whether a callback's state holds only numbers and tensors, under names that cannot be paths."""
    if isinstance(value, dict):
        return all(type(key) is int or (type(key) is str and key.isidentifier()) for key in value) and all(
            map(_is_plain, value.values())
        )
    if isinstance(value, (list, tuple)):
        return all(map(_is_plain, value))
    return value is None or isinstance(value, (bool, int, float, torch.Tensor))


def _is_number(value: Any) -> bool:
    """Return whether a value is one finite number."""
    return type(value) in (int, float) and abs(value) < 2**1000 and math.isfinite(value)


def _like(value: Any, shape: tuple[int, ...] | torch.Size) -> bool:
    """Return whether a value is a real-valued dense tensor of this shape."""
    return (
        isinstance(value, torch.Tensor)
        and value.layout == torch.strided
        and not value.is_complex()
        and not value.is_quantized
        and value.shape == torch.Size(shape)
    )


def _damaged(path: str | Path, what: str) -> BadInput:
    return BadInput(
        f"{path}: damaged, or not of this training: {what} cannot be taken up; start anew from its weights, which "
        f"convert checkpoint={path} out=weights.ckpt takes out"
    )
