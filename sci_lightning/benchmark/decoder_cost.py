"""What decoding one measurement costs on this machine: seconds and peak memory, measured in a process of its own."""

from __future__ import annotations

import math
import re
import statistics
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.decoder.paper_count import count_as_paper
from sci_lightning.errors import BadInput
from sci_lightning.imaging.operator import SnapshotOperator
from sci_lightning.runs.precision import mixed_precision


def decoder_cost(config: Mapping[str, Any], **settings: Any) -> dict[str, Any]:
    """:func:`measure` in a fresh process, so that the peak memory is this decoder's alone.

    Raises:
        BadInput: as :func:`measure`; or out of memory, which is why systems kill processes.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        try:
            return process.submit(measure, config, **settings).result()
        except RuntimeError as error:
            killed = isinstance(error, (BrokenProcessPool, torch.OutOfMemoryError))
            if not killed and "can't allocate memory" not in str(error):
                raise
            raise BadInput("did not fit into memory; give a smaller size=") from error


def measure(
    config: Mapping[str, Any],
    *,
    frames: int,
    size: tuple[int, int],
    rules: int,
    device: str,
    precision: str,
    compile: bool,
    warm_up: int,
    repeats: int,
    budget: float,
    product: int,
) -> dict[str, Any]:
    """Build a decoder, count, and decode one measurement again and again.

    Args:
        config: plain configuration of the decoder.
        frames, size: T and (H, W) of the measurement.
        rules: see :func:`~sci_lightning.decoder.paper_count.count_as_paper`.
        device: cpu, cuda, ..
        precision: of networks, by Lightning's name.
        compile: whether torch.compile is applied; its own time is part of the warm-up.
        warm_up, repeats: number of calls that are not timed, and that are.
        budget: seconds after which no further call is timed.
        product: n of the n x n matrix product whose speed is given for comparison; 0: none.

    Returns:
        ``parameters``, ``macs``, ``macs_as_paper``; ``seconds`` (median) and ``fastest`` of ``calls``; ``memory`` in
        bytes, the most that weights, activations and scratch took at a time (absent where the system does not tell);
        ``gflops``, two operations per multiply-accumulate, and ``product_gflops`` of the matrix product.

    Raises:
        BadInput: what the decoder finds wrong.
    """
    torch.manual_seed(0)
    place = torch.device(device)
    on_gpu = place.type == "cuda"
    before = 0 if on_gpu else _memory("VmRSS")
    decoder = build(config, "decoder").eval().to(place)
    mask = (torch.rand(frames, *size, device=place) < 0.5).float()
    measurement = SnapshotOperator(mask)(torch.rand(1, frames, *size, device=place))
    decode = torch.compile(decoder) if compile else decoder
    with torch.inference_mode(), mixed_precision(precision, place):
        seconds = _timed(lambda: decode(measurement, mask), place, warm_up, repeats, budget)
        peak = torch.cuda.max_memory_allocated(place) if on_gpu else _memory("VmHWM")
        one, other = torch.rand(2, product, product, device=place)
        product_seconds = min(_timed(lambda: one @ other, place, 1, 3))
    macs = count_macs(decoder, frames, *size)  # after the memory was read: counting loads a good part of torch
    return {
        "parameters": count_parameters(decoder),
        "macs": macs,
        "macs_as_paper": count_as_paper(decoder, frames, size[0], size[1], rules),
        "seconds": statistics.median(seconds),
        "fastest": min(seconds),
        "calls": len(seconds),
        **({"memory": peak - before} if peak else {}),
        "gflops": 2e-9 * macs / statistics.median(seconds),
        **({"product_gflops": 2e-9 * product**3 / product_seconds} if product else {}),
    }


def _timed(
    work: Callable[[], Any], place: torch.device, warm_up: int, repeats: int, budget: float = math.inf
) -> list[float]:
    """Seconds of each timed call."""
    for _ in range(warm_up):
        work()
    seconds: list[float] = []
    while len(seconds) < repeats and sum(seconds) < budget:
        start = _now(place)
        work()
        seconds.append(_now(place) - start)
    return seconds


def _now(place: torch.device) -> float:
    if place.type == "cuda":
        torch.cuda.synchronize(place)
    return time.perf_counter()


def _memory(field: str) -> int:
    """Bytes that this process holds (VmRSS) or has held at most (VmHWM); 0 where the system does not tell."""
    status = Path("/proc/self/status")
    match = re.search(rf"{field}:\s+(\d+) kB", status.read_text()) if status.is_file() else None
    return 1024 * int(match[1]) if match else 0
