"""What a training is going to take: steps, examples, hours and memory, from a second or two of it measured here.

``dry_run=true`` prints it, and so does every training before its first step. Nothing here loads Lightning, which takes
as long as the measurement.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.layers import kernels
from sci_lightning.decoder.layers.sequential import computed_as_larger
from sci_lightning.decoder.tiling.memory import LiveBytes, free_memory
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.device import device_name
from sci_lightning.runs.precision import device_of_accelerator, mixed_precision, resolve_precision
from sci_lightning.training.training_length import counted_steps, most_seconds

SIDE = 16
"""Height and width, in pixels, of the first clip that is measured; those of the next are twice as large, and so on."""

MEASURED_SECONDS = 4.5
"""Seconds that the measurement takes at most, if two small clips do not take longer. Two cores reach 64 x 64 pixels of
Res2former within them, from which the time of a step at 256 x 256 follows to about 10 %."""

BEYOND_ACTIVATIONS = 1.2
"""Memory of a step over what its forward pass keeps: gradients on their way, and what allocators waste.

Measured 1.06 in float32 and 1.18 in bfloat16, for Res2former at 256 x 256 on two cores.
"""

PER_PARAMETER = 16
"""Bytes for every learned value: itself, its gradient and two moments of Adam, in float32."""

ADAM_PASSES = 5
"""Readings and writings of all weights that a step of Adam is worth, with its gradients and two moments."""

DAY = 86400.0
"""Seconds."""

PLAIN_SYSTEM = "sci_lightning.training.system.System"
"""The one whose step is computed here without Lightning."""

CROWDED = 0.7
"""A single thread that takes this part of the time of all threads, or less, says that a core is taken."""


@dataclass(frozen=True)
class StepCost:
    """What a clip costs in a training step: a part for every pixel, and one that is the same for clips of any size.

    Attributes:
        seconds: of the forward and the backward pass for a clip; ``fixed_seconds`` of them whatever its size.
        fixed_seconds: see there.
        optimizer_seconds: of the optimizer, once a step.
        bytes: of the activations of a clip; ``fixed_bytes`` of all else, once.
        fixed_bytes: see there.
        busy: threads that computed at a time, on average.
        one_thread: how many times the seconds of all threads a single thread takes; below 1 where another program keeps
            a core busy, for which the others then wait again and again.
    """

    seconds: float
    fixed_seconds: float
    optimizer_seconds: float
    bytes: float
    fixed_bytes: float
    busy: float = 1.0
    one_thread: float = math.inf

    def of_step(self, clips: int, parts: int) -> float:
        """Return the seconds of a step of so many clips in each of its parts (``accumulate_grad_batches``)."""
        return parts * (clips * (self.seconds - self.fixed_seconds) + self.fixed_seconds) + self.optimizer_seconds

    def memory(self, clips: int) -> float:
        """Return the bytes that so many clips at once take, beside what the process has taken before."""
        return clips * self.bytes + self.fixed_bytes


@dataclass(frozen=True)
class TrainingPlan:
    """The size of a training.

    Attributes:
        clips_per_epoch: examples of an epoch.
        epochs: at most; a limit on time may come first.
        steps: of the optimizer, in all epochs.
        batch_size: clips of a step.
        step_seconds: of one step on the device, with all its parts.
        device: on which the step was measured, and in which precision.
        memory: bytes that a training takes on that device.
        core_minutes: limit on the processor time of the training, None for none.
        most_seconds: limit on its duration, None for none.
        busy: threads that compute at a time, on average: processor time over duration.
        one_thread: see :class:`StepCost`.
    """

    clips_per_epoch: int
    epochs: int
    steps: int
    batch_size: int
    step_seconds: float
    device: str
    memory: float = 0.0
    core_minutes: float | None = None
    most_seconds: float | None = None
    busy: float = 1.0
    one_thread: float = math.inf

    def lines(self) -> list[str]:
        """Return the plan in sentences."""
        steps, limit = self.steps, ""
        if self.core_minutes is not None:
            within = int(60 * self.core_minutes / max(self.busy * self.step_seconds, 1e-9))
            if within < steps:
                steps, limit = within, f" in {self.core_minutes:g} minutes of processor time, about"
        if self.most_seconds is not None and (within := int(self.most_seconds / max(self.step_seconds, 1e-9))) < steps:
            steps, limit = within, f" in {duration(self.most_seconds)}, about"
        epochs = steps / self.steps * self.epochs
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
            *([crowded] if self.one_thread < CROWDED else []),
        ]

    @property
    def expected_steps(self) -> int:
        """Steps of the training, within its limits."""
        return min(self.steps, int(self.seconds / max(self.step_seconds, 1e-9) + 1e-6))

    @property
    def seconds(self) -> float:
        """The expected duration of the training, within its limits."""
        budget = math.inf if self.core_minutes is None else 60 * self.core_minutes / self.busy
        return min(self.steps * self.step_seconds, budget, math.inf if self.most_seconds is None else self.most_seconds)


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
    clips, epochs, steps = counted_steps(config)
    device = device_of_accelerator(trainer["accelerator"])
    precision = resolve_precision(trainer["precision"], device)
    cost, free = measured_step(config, device, precision), free_memory(device)
    if cost.memory(batch_size) > free:
        raise BadInput(_too_large(config, cost, free))
    return TrainingPlan(
        clips,
        epochs,
        steps,
        batch_size,
        step_seconds=cost.of_step(batch_size, trainer["accumulate_grad_batches"]),
        device=f"{device_name(device)}, {precision}",
        memory=cost.memory(batch_size) + _taken(device),
        core_minutes=config["core_minutes"],
        most_seconds=most_seconds(trainer),
        busy=cost.busy,
        one_thread=cost.one_thread,
    )


def measured_step(config: Mapping[str, Any], device: torch.device, precision: str) -> StepCost:
    """Return what a clip costs in a training step on a device, from ever larger parts of one.

    Memory is a straight line over the pixels, and time becomes one: below some thousand pixels much of it is spent on
    calls, so that its slope is that between the last two parts. The last one is the whole clip where that is computed
    soon enough. The first run of all is not counted: libraries set up what they need.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config["seed"])
        encoder, decoder = _parts(config)
        kernels.use(decoder, config["kernels"])
        if any(part > whole for part, whole in zip(config["crop"], encoder.size, strict=True)):
            raise BadInput(
                f"'crop=[{config['crop'][0]},{config['crop'][1]}]': larger than the mask, {list(encoder.size)} pixels"
            )
        step = _step(config, encoder.to(device), decoder.to(device))
        learned = [p for module in (encoder, decoder) for p in module.parameters() if p.requires_grad]
        if not any(p.requires_grad for p in decoder.parameters()):  # refused by its name where the training begins
            return StepCost(0.0, 0.0, 0.0, 0.0, 0.0)
        begun, computed = _now(device), time.process_time()
        points: list[tuple[int, float, int]] = []  # pixels, seconds, bytes
        for height, width in _windows(*config["crop"]):
            times = math.prod(config["crop"]) / (height * width)
            runs: list[tuple[float, int]] = []
            while len(runs) < (2 if points else 3) and (not runs or _now(device) - begun < MEASURED_SECONDS / 2):
                with computed_as_larger(times * config["batch_size"]):
                    video = torch.rand(1, config["frames"], height, width, device=device)
                    runs.append(_timed(step, video, precision))
            points.append((height * width, *min(runs)))  # the fastest is the least disturbed
            if len(points) > 1 and _now(device) - begun + 4 * runs[-1][0] > MEASURED_SECONDS:
                break
        busy = (time.process_time() - computed) / max(_now(device) - begun, 1e-9)
        one_thread, threads = math.inf, torch.get_num_threads()
        if device.type == "cpu" and threads > 1 and runs[-1][0] < MEASURED_SECONDS / 4:
            try:
                torch.set_num_threads(1)
                one_thread = min(_timed(step, video, precision)[0] for _ in range(2)) / min(runs)[0]
            finally:
                torch.set_num_threads(threads)
        gradients = [p.grad for p in learned if p.grad is not None]
        start = _now(device)
        for _ in range(ADAM_PASSES if gradients else 0):  # torch's optimizer itself loads the compiler, for seconds
            torch._foreach_mul_(gradients, 1.0)
        stepped = _now(device) - start
    pixels, values = math.prod(config["crop"]), sum(p.numel() for p in learned)
    seconds, fixed_seconds = _line([(area, value) for area, value, _ in points[-2:]], pixels)
    activations, _ = _line([(area, value) for area, _, value in points], pixels)
    fixed_bytes = PER_PARAMETER * values
    kept = BEYOND_ACTIVATIONS * activations
    return StepCost(seconds, fixed_seconds, stepped, kept, fixed_bytes, max(busy, 0.1), one_thread)


def _parts(config: Mapping[str, Any]) -> tuple[Encoder, Decoder]:
    """Build encoder and decoder as they cost, without searching for a mask to begin with, which takes seconds."""
    settings = dict(config["encoder"])
    if isinstance(mask := settings.get("mask"), Mapping) and "start" in mask:
        settings["mask"] = {**mask, "start": "published"}
    return build(settings, "encoder"), build(config["decoder"], "decoder").train()


def _step(config: Mapping[str, Any], encoder: Encoder, decoder: Decoder) -> Callable[[torch.Tensor], torch.Tensor]:
    """Return the function from a clip ``(1, T, h, w)`` to its loss."""
    if config["system"]["_target_"] != PLAIN_SYSTEM:  # which is a LightningModule, and may compute anything
        system = build(config["system"], "system", encoder=encoder, decoder=decoder)
        return lambda video: system.training_step(video, 0)
    pipeline = Pipeline(encoder, decoder)

    def loss(video: torch.Tensor) -> torch.Tensor:
        mask = encoder.transmittance_window(0, 0, *video.shape[-2:])
        linear = pipeline.linearise(pipeline.record(video, mask, (0, 0)), origin=(0, 0))
        stages = decoder.stages(linear, pipeline.decoder_mask(mask))[-len(config["system"]["stage_weights"]) :]
        return torch.stack([(stage - video).square().mean() for stage in stages]).sum()

    return loss


def _windows(height: int, width: int) -> list[tuple[int, int]]:
    """Return heights and widths that double up to those of the whole clip."""
    windows = [(min(SIDE, height), min(SIDE, width))]
    while windows[-1] != (height, width):
        windows.append((min(2 * windows[-1][0], height), min(2 * windows[-1][1], width)))
    return windows


def _timed(step: Callable[[torch.Tensor], torch.Tensor], video: torch.Tensor, precision: str) -> tuple[float, int]:
    """Return the seconds of the forward and the backward pass of a clip, and the bytes that the former keeps."""
    start = _now(video.device)
    with LiveBytes() as live, mixed_precision(precision, video.device):
        loss = step(video)
        kept = live.now
    loss.backward()
    return _now(video.device) - start, kept


def _line(points: list[tuple[int, float]], at: int) -> tuple[float, float]:
    """Return the value at ``at`` of the line through the first and the last point, and its value at 0, not below 0."""
    (first, low), (last, high) = points[0], points[-1]
    slope = (high - low) / (last - first) if last > first and high > low else high / last
    return high + slope * (at - last), max(0.0, high - slope * last)


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


def _now(device: torch.device) -> float:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()
