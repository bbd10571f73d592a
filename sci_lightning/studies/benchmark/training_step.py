"""What a training step of a decoder costs: forward, loss, backward and Adam, in every precision in turns."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import torch

from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_macs
from sci_lightning.operator import SnapshotOperator
from sci_lightning.runs.precision import mixed_precision
from sci_lightning.studies.benchmark.timing import Call, seconds_in_turns, times_as_fast


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
    """Train a decoder for a few steps on random video and say how long one takes.

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
