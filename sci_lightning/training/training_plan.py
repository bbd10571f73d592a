"""What a training is going to take: its steps, its examples and, from one measured step, its hours on this machine."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from lightning.pytorch.callbacks import Timer

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput
from sci_lightning.runs.device import device_name
from sci_lightning.runs.precision import device_of_accelerator, mixed_precision, resolve_precision
from sci_lightning.training.system import System

SIDE = 64
"""Height and width, in pixels, of the clip that a step is measured with; larger ones take time with their pixels."""


@dataclass(frozen=True)
class TrainingPlan:
    """The size of a training.

    Attributes:
        clips_per_epoch: examples of an epoch.
        epochs: at most; a limit on time may come first.
        steps: of the optimizer, in all epochs.
        batch_size: clips of a step.
        step_seconds: of one step on the device.
        device: on which the step was measured, and in which precision.
        core_minutes: limit on the processor time of the training, None for none.
        most_seconds: limit on its duration, None for none.
    """

    clips_per_epoch: int
    epochs: int
    steps: int
    batch_size: int
    step_seconds: float
    device: str
    core_minutes: float | None = None
    most_seconds: float | None = None

    def lines(self) -> list[str]:
        """Return the plan in sentences."""
        steps, limit = self.steps, ""
        if self.core_minutes is not None and (within := int(60 * self.core_minutes / self.step_seconds)) < steps:
            steps, limit = within, f" in {self.core_minutes:g} minutes of processor time, about"
        if self.most_seconds is not None and (within := int(self.most_seconds / self.step_seconds)) < steps:
            steps, limit = within, f" in {duration(self.most_seconds)}, about"
        epochs = steps / self.steps * self.epochs
        return [
            f"{steps:,} steps of {_count(self.batch_size, 'clip')}{limit}: {_count(epochs, 'epoch')} of "
            f"{self.clips_per_epoch:,} clips, {steps * self.batch_size:,} examples",
            f"a step takes about {self.step_seconds:.3g} s on {self.device} (measured on one clip of {SIDE} x {SIDE} "
            "pixels or less, in proportion to pixels and clips)",
            duration_line(self.steps * self.step_seconds, self.core_minutes, self.most_seconds),
        ]


def _count(number: float, noun: str) -> str:
    return f"{number:,.3g} {noun}{'' if number == 1 else 's'}"


def duration_line(seconds: float, core_minutes: float | None = None, most_seconds: float | None = None) -> str:
    """Return how long a training takes, in words, and what would be shorter if that is more than a day.

    Args:
        seconds: of all steps that are left.
        core_minutes: what is left of a limit on processor time; None for none.
        most_seconds: what is left of a limit on the duration; None for none.
    """
    budget = math.inf if core_minutes is None else 60 * core_minutes
    if most_seconds is not None and most_seconds < min(seconds, budget):
        return f"training ends after {duration(most_seconds)}"
    if core_minutes is not None and 60 * core_minutes < seconds:
        return f"training ends after {duration(60 * core_minutes)} of processor time"
    shorter = "; scale=cpu takes 45 minutes of one core" if seconds > 86400 else ""
    return f"training takes about {duration(seconds)} on this machine{shorter}"


def duration(seconds: float) -> str:
    """Return a time with two digits in the largest unit that fits: ``45 minutes``, ``3.2 hours``, ``170 days``."""
    for unit, length in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            number = seconds / length
            return (
                f"{number:.1f} {unit}" if number < 10 and unit != "minutes" else f"{float(f'{number:.2g}'):,.0f} {unit}"
            )
    return f"{seconds:.0f} seconds"


def training_plan(config: Mapping[str, Any]) -> TrainingPlan:
    """Count the steps of a training and measure one; nothing is written, and no data is read where none is needed.

    Args:
        config: ``conf/train.yaml``, composed and plain. ``data.root`` may be missing if ``data.clips_per_epoch`` is
            given.

    Raises:
        BadInput: settings of no use.
    """
    trainer, batch_size = config["trainer"], config["batch_size"]
    clips = config["data"].get("clips_per_epoch") or len(build(config["data"], "data").clips())
    batches = clips // batch_size
    if not batches:
        raise BadInput(f"batch_size={batch_size}: an epoch of {clips} clips has no whole batch")
    if (limit := trainer.get("limit_train_batches")) is not None:
        batches = int(batches * limit) if isinstance(limit, float) else min(batches, limit)
        if not batches:
            raise BadInput(f"trainer.limit_train_batches={limit}: leaves no batch of {clips // batch_size}")
    epochs = trainer["max_epochs"]
    steps = math.ceil(batches / trainer["accumulate_grad_batches"]) * epochs
    if trainer["max_steps"] > 0:
        steps = min(steps, trainer["max_steps"])
    device = device_of_accelerator(trainer["accelerator"])
    precision = resolve_precision(trainer["precision"], device)
    seconds = measured_step(config, device, precision)
    name = f"{device_name(device)}, {precision}"
    most = Timer(trainer["max_time"]).time_remaining() if trainer.get("max_time") else None
    return TrainingPlan(clips, epochs, steps, batch_size, seconds, name, config["core_minutes"], most)


def measured_step(config: Mapping[str, Any], device: torch.device, precision: str) -> float:
    """Return the seconds of a training step on a device, from those of one small clip.

    Forward and backward pass take time with the pixels; what the optimizer takes does not depend on them.
    """
    torch.manual_seed(config["seed"])
    encoder, decoder = build(config["encoder"], "encoder"), build(config["decoder"], "decoder")
    system: System = build(config["system"], "system", encoder=encoder, decoder=decoder).to(device)
    height, width = (min(SIDE, side) for side in config["crop"])
    video = torch.rand(1, config["frames"], height, width, device=device)
    optimizer = torch.optim.Adam([p for p in system.parameters() if p.requires_grad])
    for _ in range(2):  # the first one allocates
        start = _now(device)
        with mixed_precision(precision, device):
            loss = system.batch_loss(video)
        loss.backward()
        computed = _now(device)
        optimizer.step()
        optimizer.zero_grad()
        stepped = _now(device)
    pixels = math.prod(config["crop"]) / (height * width)
    return (computed - start) * pixels * config["batch_size"] + stepped - computed


def _now(device: torch.device) -> float:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()
