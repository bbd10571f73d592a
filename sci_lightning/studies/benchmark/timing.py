"""Times of calls that take turns, so that what else a machine does meets all alike; of training steps as well."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch.nn import functional as F

from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_macs
from sci_lightning.operator import SnapshotOperator
from sci_lightning.runs.precision import DTYPES, mixed_precision

Call = Callable[[], Any]


def seconds_in_turns(
    calls: Mapping[str, Call], device: torch.device, warm_up: int, repeats: int, budget: float = math.inf
) -> dict[str, list[float]]:
    """Return the seconds of every timed call, by name: one call of each, then the next one of each.

    Args:
        calls: what is timed.
        device: device whose work is waited for.
        warm_up, repeats: number of rounds that are not timed, and that are.
        budget: seconds of all calls after which no further round begins.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(warm_up + repeats):
        if number > warm_up and sum(map(sum, seconds.values())) >= budget:
            break
        for name, call in calls.items():
            start = now(device)
            call()
            if number >= warm_up:
                seconds[name].append(now(device) - start)
    return seconds


def now(device: torch.device) -> float:
    """Return the time in seconds once the device has done its work."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def times_as_fast(faster: list[float], slower: list[float]) -> float:
    """Return the median over rounds of how many times the first takes within the second."""
    return statistics.median(after / before for before, after in zip(faster, slower, strict=True))


CHANNELS, SIDE = 64, 256
"""Of the convolution: 3 x 3 from 64 to 64 channels on 256 x 256 pixels, channels last."""

CALLS = 5
"""Timed calls, of which the fastest counts: the machine's speed is what nothing disturbs."""


def machine_speed(
    precisions: Sequence[str], device: torch.device, product: int, training: bool = False
) -> dict[str, dict[str, float]]:
    """Return 10^9 operations a second by precision: ``product_gflops``, ``convolution_gflops``.

    Args:
        precisions: by Lightning's names; float32 is what ``32-true`` multiplies, bfloat16 ``bf16-mixed``.
        device: device.
        product: n of the n x n matrix product; 0: measure nothing.
        training: whether to measure a convolution with its gradients as well, ``convolution_training_gflops``.
    """
    if not product:
        return {}
    speeds: dict[str, dict[str, float]] = {}
    for precision in precisions:
        dtype = DTYPES[precision] or torch.float32
        one, other = torch.rand(2, product, product, device=device).to(dtype)
        image = torch.rand(1, CHANNELS, SIDE, SIDE, device=device).to(dtype, memory_format=torch.channels_last)
        weight = torch.rand(CHANNELS, CHANNELS, 3, 3, device=device).to(dtype, memory_format=torch.channels_last)
        flops = 2 * 9 * CHANNELS**2 * SIDE**2
        work = {
            "product_gflops": (2 * product**3, lambda one=one, other=other: one @ other),
            "convolution_gflops": (flops, lambda x=image, w=weight: F.conv2d(x, w, padding=1)),
        }
        if training:
            x, w = (torch.rand_like(value).requires_grad_() for value in (image, weight))
            work["convolution_training_gflops"] = (3 * flops, lambda x=x, w=w: _with_gradients(x, w))
        with torch.inference_mode(False), torch.set_grad_enabled(training):
            seconds = seconds_in_turns({name: call for name, (_, call) in work.items()}, device, 1, CALLS)
        speeds[precision] = {name: 1e-9 * count / min(seconds[name]) for name, (count, _) in work.items()}
    return speeds


def _with_gradients(x: torch.Tensor, weight: torch.Tensor) -> None:
    result = F.conv2d(x, weight, padding=1)
    torch.autograd.grad(result, (x, weight), torch.ones_like(result))


def training_step(
    decoder: Decoder,
    frames: int,
    size: tuple[int, int],
    snapshots: int,
    precisions: Sequence[str],
    device: torch.device,
    warm_up: int,
    repeats: int,
    budget: float,
) -> dict[str, Any]:
    """Train a decoder for a few steps on random video and say how long one takes: forward, loss, backward and Adam.

    The gradient of the mask is computed as well, as in a joint training. The weights are changed.

    Returns:
        ``snapshots``, those of a step; ``precisions`` with ``seconds`` (median), ``fastest`` and ``gflops``, counting
        the backward pass as twice the forward pass; ``times_as_fast``, the last precision against the first, where
        there are two.
    """
    decoder.train()
    optimizer = torch.optim.Adam(decoder.parameters(), lr=1e-5, fused=True)
    video = torch.rand(snapshots, frames, *size, device=device)
    mask = (torch.rand(frames, *size, device=device) < 0.5).float().requires_grad_()

    def step_in(precision: str) -> Call:
        def step() -> None:
            optimizer.zero_grad(set_to_none=True)
            mask.grad = None
            with mixed_precision(precision, device):
                estimate = decoder(SnapshotOperator(mask)(video), mask)
            (estimate.float() - video).square().mean().backward()
            optimizer.step()

        return step

    with torch.inference_mode(False), torch.enable_grad():
        steps = {precision: step_in(precision) for precision in precisions}
        seconds = seconds_in_turns(steps, device, warm_up, repeats, budget)
    flops = 3 * 2e-9 * snapshots * count_macs(decoder, frames, *size)
    costs = {
        precision: {
            "seconds": statistics.median(times),
            "fastest": min(times),
            "gflops": flops / statistics.median(times),
        }
        for precision, times in seconds.items()
    }
    gain = {"times_as_fast": times_as_fast(seconds[precisions[-1]], seconds[precisions[0]])}
    return {"snapshots": snapshots, "precisions": costs, **(gain if len(precisions) > 1 else {})}
