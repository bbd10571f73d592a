"""What a training is going to take: steps, examples, hours and memory, from a second or two of it measured here.

``dry_run=true`` prints it, and so does every training before its first step. Nothing here loads Lightning, which takes
as long as the measurement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.data.source import Source
from sci_lightning.decoder.tiling.memory import free_memory
from sci_lightning.errors import BadInput
from sci_lightning.runs.device import device_name
from sci_lightning.runs.precision import device_of_accelerator, resolve_precision
from sci_lightning.training.scoring import build_metrics
from sci_lightning.training.step_cost import SIDE, StepCost, measured_step, now
from sci_lightning.training.training_length import (
    counted_snapshots,
    counted_steps,
    most_seconds,
    source_of,
    steps_between_validations,
)

LARGEST_SCORED = 256
"""Height and width, in pixels, of the largest frame on which metrics are timed; larger ones take in proportion."""

DAY = 86400.0
"""Seconds."""

CROWDED = 0.7
"""A single thread that takes this part of the time of all threads, or less, says that a core is taken."""


@dataclass(frozen=True)
class TrainingPlan:
    """The size of a training.

    Attributes:
        clips_per_epoch: examples of an epoch.
        steps_per_epoch: of the optimizer.
        steps: of the optimizer, in all epochs; a limit on time may come first.
        batch_size: clips of a step.
        step_seconds: of one step on the device, with all its parts.
        device: on which the step was measured, and in which precision.
        memory: bytes that a training takes on that device.
        core_minutes: limit on the processor time of the training, None for none.
        most_seconds: limit on its duration, None for none.
        busy: threads that compute at a time, on average: processor time over duration.
        one_thread: see :class:`StepCost`.
        split: which clips the source has kept for validation, in words; empty where the user has named them.
        validation_steps: steps after which a validation follows.
        validation_seconds: of one validation.
        test_seconds: of the tests at the end; None where the scenes are not known.
    """

    clips_per_epoch: int
    steps_per_epoch: int
    steps: int
    batch_size: int
    step_seconds: float
    device: str
    memory: float = 0.0
    core_minutes: float | None = None
    most_seconds: float | None = None
    busy: float = 1.0
    one_thread: float = math.inf
    split: str = ""
    validation_steps: float = math.inf
    validation_seconds: float = 0.0
    test_seconds: float | None = None

    def lines(self) -> list[str]:
        """Return the plan in sentences."""
        steps, (_, limit) = self.expected_steps, min(self._limits())
        epochs = steps / self.steps_per_epoch
        crowded = (
            f"another program keeps a core busy, and threads wait for each other: with OMP_NUM_THREADS=1 in front of "
            f"the command a step takes about {self.step_seconds * self.one_thread:.2g} s as long as it does"
        )
        return [
            f"{steps:,} steps of {_count(self.batch_size, 'clip')}{limit}: {_count(epochs, 'epoch')} of "
            f"{self.clips_per_epoch:,} clips, {steps * self.batch_size:,} examples",
            f"a step takes about {self.step_seconds:.3g} s and {self.memory / 1e9:.2g} GB of memory on {self.device} "
            "(from small clips, measured now)",
            duration_line(self.steps * self.step_seconds, self.core_minutes, self.most_seconds),
            self._scoring_line(steps),
            *([self.split] if self.split else []),
            *([crowded] if self.one_thread < CROWDED else []),
        ]

    def _scoring_line(self, steps: int) -> str:
        """Say what validations and tests take beside so many steps, and above that of the steps what shortens it."""
        if self.test_seconds is None:
            return "validations and tests come on top"
        validations = int(steps / self.validation_steps)
        seconds = validations * self.validation_seconds
        line = f"{_count(validations, 'validation')} and the test take about {duration(seconds + self.test_seconds)} "
        if seconds <= steps * self.step_seconds:
            return f"{line}more"
        return f"{line}more; trainer.check_val_every_n_epoch=N, or a larger data.clips_per_epoch, validates less often"

    @property
    def expected_steps(self) -> int:
        """Steps of the training, within its limits."""
        return min(self.steps, int(self.seconds / max(self.step_seconds, 1e-9) + 1e-6))

    @property
    def seconds(self) -> float:
        """The expected duration of all steps, within the limits of the training."""
        return min(self._limits())[0]

    def _limits(self) -> list[tuple[float, str]]:
        """Return what the steps take if all are done, and what every limit leaves for them, each with a few words."""
        limits = [(self.steps * self.step_seconds, "")]
        if self.core_minutes is not None:
            words = f" in {duration(60 * self.core_minutes)} of processor time, about"
            limits.append((60 * self.core_minutes / self.busy, words))
        if self.most_seconds is not None:  # which holds for steps and validations
            validating = self.validation_seconds / self.validation_steps
            share = self.step_seconds / max(self.step_seconds + validating, 1e-9)
            limits.append((self.most_seconds * share, f" in {duration(self.most_seconds)}, about"))
        return limits


def _count(number: float, noun: str) -> str:
    return f"{number:,.3g} {noun}{'' if number == 1 else 's'}"


def duration_line(seconds: float, core_minutes: float | None = None, most_seconds: float | None = None) -> str:
    """Return how long a training takes, in words.

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
    return f"training takes about {duration(seconds)} on this machine"


def duration(seconds: float) -> str:
    """Return a time with two digits in the largest unit that fits: ``45 minutes``, ``3.2 hours``, ``170 days``."""
    for unit, length in (("days", DAY), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            number = seconds / length
            digits = f"{number:.1f}" if number < 10 and unit != "minutes" else f"{float(f'{number:.2g}'):,.0f}"
            return f"{digits} {unit}"
    return f"{seconds:.0f} seconds"


def training_plan(config: Mapping[str, Any]) -> TrainingPlan:
    """Count the steps of a training and measure parts of one; nothing is written, and no data is read without need.

    Args:
        config: ``conf/train.yaml``, composed and plain. ``data.root`` may be missing if ``data.clips_per_epoch`` is
            given.

    Raises:
        BadInput: settings of no use, or a step that does not fit into the memory; the message says what would.
    """
    trainer, batch_size = config["trainer"], config["batch_size"]
    source = source_of(config)
    clips, per_epoch, steps = counted_steps(config, source)
    device = device_of_accelerator(trainer["accelerator"])
    precision = resolve_precision(trainer["precision"], device)
    cost, free = measured_step(config, device, precision), free_memory(device)
    if cost.memory(batch_size) > free:
        raise BadInput(_too_large(config, cost, free))
    scoring = {} if source is None else _scoring_seconds(config, source, cost, device)
    return TrainingPlan(
        clips,
        per_epoch,
        steps,
        batch_size,
        step_seconds=cost.of_step(batch_size, trainer["accumulate_grad_batches"]),
        device=f"{device_name(device)}, {precision}",
        memory=cost.memory(batch_size) + _taken(device),
        core_minutes=config["core_minutes"],
        most_seconds=most_seconds(trainer),
        busy=cost.busy,
        one_thread=cost.one_thread,
        split=getattr(source, "held_out_in_words", ""),
        validation_steps=steps_between_validations(trainer, per_epoch),
        **scoring,
    )


def _scoring_seconds(
    config: Mapping[str, Any], source: Source, cost: StepCost, device: torch.device
) -> dict[str, float]:
    """Return the seconds of a validation and of all tests: snapshots are decoded, and their frames compared."""
    size, trainer = config["size"], config["trainer"]
    seconds = {}
    frame = torch.rand(1, *(min(side, LARGEST_SCORED) for side in size), device=device)
    for name, metric in build_metrics(config.get("metrics", {}), size).items():
        for _ in range(2):  # the first one sets up what it needs
            start = now(device)
            metric.to(device).update(frame, frame)
            seconds[name] = (now(device) - start) * math.prod(size) / frame.numel()
    every = config["system"].get("val_every_n_frames") or {}
    compared = seconds["psnr"] + sum(value / max(1, every.get(name, 1)) for name, value in seconds.items())
    decoded, frames = cost.of_snapshot(math.prod(size) / math.prod(config["crop"])), config["frames"]
    held_out = source.scenes()
    tested = build(config["benchmark"], "benchmark").scenes() if config["benchmark"]["root"] else held_out
    validated = counted_snapshots(held_out, trainer.get("limit_val_batches"))
    tests = (1 + len(config["test_encoders"])) * counted_snapshots(tested, trainer.get("limit_test_batches"))
    return {
        "validation_seconds": validated * (decoded + frames * compared),
        "test_seconds": tests
        * (decoded + 2 * frames * sum(seconds.values())),  # the mean measurement is scored as well
    }


def _too_large(config: Mapping[str, Any], cost: StepCost, free: float) -> str:
    """Say that a step does not fit into the memory, and which settings would make it fit."""
    clips, (height, width) = config["batch_size"], config["crop"]
    fitting = next((n for n in range(clips, 0, -1) if clips % n == 0 and cost.memory(n) <= free), 0)
    share = (free - cost.fixed_bytes) / cost.bytes
    rows, columns = (int(math.sqrt(max(share, 0)) * side) // 16 * 16 for side in (height, width))
    if fitting:
        parts = clips // fitting * config["trainer"]["accumulate_grad_batches"]
        right = f"batch_size={fitting} trainer.accumulate_grad_batches={parts} is the same training in smaller parts"
    elif min(rows, columns) >= SIDE:
        right = f"batch_size=1 'crop=[{rows},{columns}]' would fit"
    else:
        right = "choose a smaller network, as scale=cpu has"
    if config["decoder"].get("checkpoint") is False:
        right += "; decoder.checkpoint=true takes less memory and a third more time"
    return (
        f"batch_size={clips} 'crop=[{height},{width}]': a step needs about {cost.memory(clips) / 1e9:.2g} GB of "
        f"memory, {free / 1e9:.2g} GB are free here; {right}"
    )


def _taken(device: torch.device) -> float:
    """Return the bytes that this process has taken on a device."""
    if device.type == "cuda":
        return float(torch.cuda.memory_allocated(device))
    import resource

    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
