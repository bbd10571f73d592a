"""What a step of a training costs in time and memory, from a second or two of it measured here, without Lightning."""

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
from sci_lightning.decoder.tiling.memory import LiveBytes
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.precision import mixed_precision

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

PLAIN_SYSTEM = "sci_lightning.training.system.System"
"""The one whose step is computed here without Lightning."""


@dataclass(frozen=True)
class StepCost:
    """What a clip costs in a training step: a part for every pixel, and one that is the same for clips of any size.

    Attributes:
        seconds: of the forward and the backward pass for a clip; ``fixed_seconds`` of them whatever its size.
        fixed_seconds: see there.
        optimizer_seconds: of the optimizer, once a step.
        decoding: time of recording and decoding alone, without gradients, as a part of both passes.
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
    decoding: float = 1 / 3

    def of_step(self, clips: int, parts: int) -> float:
        """Return the seconds of a step of so many clips in each of its parts (``accumulate_grad_batches``)."""
        return parts * (clips * (self.seconds - self.fixed_seconds) + self.fixed_seconds) + self.optimizer_seconds

    def of_snapshot(self, pixels: float) -> float:
        """Return the seconds of decoding a snapshot with so many times the pixels of a training clip."""
        return self.decoding * (pixels * (self.seconds - self.fixed_seconds) + self.fixed_seconds)

    def memory(self, clips: int) -> float:
        """Return the bytes that so many clips at once take, beside what the process has taken before."""
        return clips * self.bytes + self.fixed_bytes


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
        begun, computed = now(device), time.process_time()
        points: list[tuple[int, float, int]] = []  # pixels, seconds, bytes
        for height, width in _windows(*config["crop"]):
            times = math.prod(config["crop"]) / (height * width)
            runs: list[tuple[float, int]] = []
            while len(runs) < (2 if points else 3) and (not runs or now(device) - begun < MEASURED_SECONDS / 2):
                with computed_as_larger(times * config["batch_size"]):
                    video = torch.rand(1, config["frames"], height, width, device=device)
                    runs.append(_timed(step, video, precision))
            points.append((height * width, *min(runs)))  # the fastest is the least disturbed
            if len(points) > 1 and now(device) - begun + 4 * runs[-1][0] > MEASURED_SECONDS:
                break
        busy = (time.process_time() - computed) / max(now(device) - begun, 1e-9)
        one_thread, threads = math.inf, torch.get_num_threads()
        if device.type == "cpu" and threads > 1 and runs[-1][0] < MEASURED_SECONDS / 4:
            try:
                torch.set_num_threads(1)
                one_thread = min(_timed(step, video, precision)[0] for _ in range(2)) / min(runs)[0]
            finally:
                torch.set_num_threads(threads)
        decoding = min(_decoding_seconds(step, video, precision) for _ in range(2)) / min(runs)[0]
        gradients = [p.grad for p in learned if p.grad is not None]
        start = now(device)
        for _ in range(ADAM_PASSES if gradients else 0):  # torch's optimizer itself loads the compiler, for seconds
            torch._foreach_mul_(gradients, 1.0)
        stepped = now(device) - start
    pixels, values = math.prod(config["crop"]), sum(p.numel() for p in learned)
    seconds, fixed_seconds = _line([(area, value) for area, value, _ in points[-2:]], pixels)
    activations, _ = _line([(area, value) for area, _, value in points], pixels)
    fixed_bytes = PER_PARAMETER * values
    kept = BEYOND_ACTIVATIONS * activations
    return StepCost(seconds, fixed_seconds, stepped, kept, fixed_bytes, max(busy, 0.1), one_thread, decoding)


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
    start = now(video.device)
    with LiveBytes() as live, mixed_precision(precision, video.device):
        loss = step(video)
        kept = live.now
    loss.backward()
    return now(video.device) - start, kept


@torch.no_grad()
def _decoding_seconds(step: Callable[[torch.Tensor], torch.Tensor], video: torch.Tensor, precision: str) -> float:
    start = now(video.device)
    with mixed_precision(precision, video.device):
        step(video)
    return now(video.device) - start


def _line(points: list[tuple[int, float]], at: int) -> tuple[float, float]:
    """Return the value at ``at`` of the line through the first and the last point, and its value at 0, not below 0."""
    (first, low), (last, high) = points[0], points[-1]
    slope = (high - low) / (last - first) if last > first and high > low else high / last
    return high + slope * (at - last), max(0.0, high - slope * last)


def now(device: torch.device) -> float:
    """Return the time in seconds at which all that a device was asked for is done."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()
