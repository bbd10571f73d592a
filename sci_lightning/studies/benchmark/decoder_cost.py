"""What decoding one measurement costs on this machine: seconds and peak memory, measured in a process of its own."""

from __future__ import annotations

import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.data.source import Source
from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_as_paper, count_macs, count_parameters
from sci_lightning.decoder.layers import kernels
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.errors import BadInput
from sci_lightning.full_precision import full_precision
from sci_lightning.metrics.psnr import psnr
from sci_lightning.operator import SnapshotOperator
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.precision import mixed_precision
from sci_lightning.studies.benchmark.timing import Call, machine_speed, seconds_in_turns, training_step

if TYPE_CHECKING:
    from sci_lightning.runs.checkpoint import Checkpoint

_said: Any = None
"""In the process that measures: the queue of what it says of its progress."""


def scene_snapshot(
    source: Source, checkpoint: Checkpoint | None, seed: int
) -> tuple[str, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return a scene's name, its measurement ``(1, H, W)``, the mask ``(T, H, W)`` and the video ``(1, T, H, W)``.

    Args:
        source: whose first scene is taken.
        checkpoint: whose encoder records; None: a random binary mask and no sensor.
        seed: of the random mask and the sensor's noise.

    Raises:
        BadInput: a scene of another size than the encoder's mask.
    """
    scene = source.scenes()[0]
    video = scene.video[0][None]
    torch.manual_seed(seed)
    if checkpoint is None:
        mask = (torch.rand(video.shape[1:]) < 0.5).float()
        return scene.name, SnapshotOperator(mask)(video), mask, video
    pipeline = Pipeline(checkpoint.encoder(), checkpoint.decoder())
    with torch.no_grad():
        mask = pipeline.decoder_mask()
        if mask.shape != video.shape[1:]:
            raise BadInput(
                f"the checkpoint's mask is {tuple(mask.shape)} (T, H, W), the scene {tuple(video.shape[1:])}: leave "
                "size= out, or give data of that size"
            )
        return scene.name, pipeline.linearise(pipeline.record(video)), mask, video


def decoder_cost(
    config: Mapping[str, Any], on_progress: Callable[[str], object] | None = None, **settings: Any
) -> dict[str, Any]:
    """:func:`measure` in a fresh process, so that the peak memory is this decoder's alone.

    Args:
        config, settings: see there.
        on_progress: called with a few words on what is being computed.

    Raises:
        BadInput: as :func:`measure`; or out of memory, which is why systems kill processes.
    """
    context = get_context("spawn")
    said = context.SimpleQueue()
    with ProcessPoolExecutor(1, mp_context=context, initializer=_report_to, initargs=(said,)) as process:
        try:
            result = process.submit(measure, config, **settings)
            while not wait([result], timeout=0.2).done or not said.empty():
                while not said.empty():
                    words = said.get()
                    if on_progress is not None:
                        on_progress(words)
            return result.result()
        except RuntimeError as error:
            killed = isinstance(error, (BrokenProcessPool, torch.OutOfMemoryError))
            if not killed and "can't allocate memory" not in str(error):
                raise
            raise BadInput("did not fit into memory; give a smaller size=") from error


def _report_to(queue: Any) -> None:
    global _said
    _said = queue


def _report(words: str) -> None:
    if _said is not None:
        _said.put(words)


def measure(
    config: Mapping[str, Any],
    *,
    frames: int,
    size: tuple[int, int],
    rules: int,
    device: str | torch.device,
    precisions: Sequence[str],
    compile: bool,
    warm_up: int,
    repeats: int,
    budget: float,
    product: int,
    tile: str | Sequence[int] = "auto",
    threads: int | None = None,
    plain_kernels: bool = False,
    training: int = 0,
    state: Mapping[str, torch.Tensor] | None = None,
    snapshot: tuple[torch.Tensor, torch.Tensor, torch.Tensor] | None = None,
) -> dict[str, Any]:
    """Build a decoder, count, and decode one measurement again and again, in every precision in turns.

    Args:
        config: plain configuration of the decoder.
        frames, size: T and (H, W) of the measurement.
        rules: see :func:`~sci_lightning.decoder.complexity.count_as_paper`.
        device: cpu, cuda, ..
        precisions: of networks, by Lightning's names, the most exact first.
        compile: whether torch.compile is applied; its own time is part of the warm-up.
        warm_up, repeats: number of calls that are not timed, and that are.
        budget: seconds after which no further call is timed.
        product: n of the n x n matrix product whose speed is given for comparison; 0: none, nor a convolution.
        tile: how a large field is cut, see :class:`~sci_lightning.decoder.tiling.tile_choice.TileChoice`.
        threads: of torch; None: as many as it takes by itself.
        plain_kernels: whether networks are computed with ``kernels=plain``.
        training: snapshots of a training step that is timed as well; 0: none.
        state: weights, ``decoder.*`` of a checkpoint without that prefix; None: random ones.
        snapshot: measurement ``(1, H, W)``, mask ``(T, H, W)`` and true video ``(1, T, H, W)``; None: random ones.

    Returns:
        ``parameters``, ``macs``, ``macs_as_paper``; ``precisions`` with ``seconds`` (median), ``fastest`` of ``calls``,
        ``gflops``, two operations per multiply-accumulate, ``memory`` in bytes, the most that weights, activations and
        scratch took at a time (absent where the system does not tell), and ``psnr`` of the video in dB; ``machine``,
        see :func:`~.timing.machine_speed`; ``training``, see :mod:`~.training_step`.

    Raises:
        BadInput: what the decoder finds wrong.
    """
    torch.manual_seed(0)
    if threads:
        torch.set_num_threads(threads)
    device = torch.device(device)
    before = 0 if device.type == "cuda" else _memory("VmRSS")
    decoder: Decoder = build(config, "decoder").eval().to(device)
    kernels.use(decoder, "plain" if plain_kernels else "auto")
    if state is not None:
        decoder.load_state_dict(dict(state))
    if snapshot is None:
        mask = (torch.rand(frames, *size) < 0.5).float()
        video = torch.rand(1, frames, *size)
        snapshot = SnapshotOperator(mask)(video), mask, video
    measurement, mask, truth = (value.to(device) for value in snapshot)
    decode = torch.compile(decoder) if compile else decoder
    videos: dict[str, torch.Tensor] = {}

    choice = TileChoice(
        tile, _report, None if decoder.global_steps else lambda part, of: _report(f"tile {part} of {of}")
    )
    decoder.watch = lambda state: _report(str(state))

    def decoded() -> torch.Tensor:
        tiling = choice.tiling(decoder, measurement, mask)
        return decode(measurement, mask) if tiling is None else decoder.in_tiles(measurement, mask, tiling)

    def call_in(precision: str, name: str, function: Any) -> Call:
        def call() -> None:
            _report(name)
            with torch.inference_mode(), mixed_precision(precision, device):
                videos[name] = function()

        return call

    calls = {precision: call_in(precision, precision, decoded) for precision in precisions}
    memory: dict[str, int] = {}
    for precision in reversed(precisions):  # what the allocator keeps of a call would count in the next, smaller one
        _reset_peak(device)
        calls[precision]()
        peak = torch.cuda.max_memory_allocated(device) if device.type == "cuda" else _memory("VmHWM")
        memory |= {precision: peak - before} if peak else {}
    # everything has been called once above
    seconds = seconds_in_turns(calls, device, max(0, warm_up - 1), repeats, budget)
    _report("the machine's own speed")
    speeds = machine_speed(precisions, device, product, training > 0)
    _report("counting operations")
    macs = count_macs(decoder, frames, *size)  # after the memory was read: counting loads a good part of torch
    result: dict[str, Any] = {
        "parameters": count_parameters(decoder),
        "macs": macs,
        "macs_as_paper": count_as_paper(decoder, frames, size[0], size[1], rules),
        "precisions": {},
    }
    for precision in precisions:
        times = seconds[precision]
        with full_precision():
            quality = float(psnr(videos[precision].float(), truth).mean())
        result["precisions"][precision] = {
            "seconds": statistics.median(times),
            "fastest": min(times),
            "calls": len(times),
            **({"memory": memory[precision]} if precision in memory else {}),
            "gflops": 2e-9 * macs / statistics.median(times),
            "psnr": quality,
        }
    if speeds:
        result["machine"] = speeds
    if training and count_parameters(decoder):
        result["training"] = training_step(
            decoder, frames, size, training, precisions, device, warm_up, repeats, budget
        )
    return result


def _memory(field: str) -> int:
    """Bytes that this process holds (VmRSS) or has held at most (VmHWM); 0 where the system does not tell."""
    status = Path("/proc/self/status")
    match = re.search(rf"{field}:\s+(\d+) kB", status.read_text()) if status.is_file() else None
    return 1024 * int(match[1]) if match else 0


def _reset_peak(device: torch.device) -> None:
    """Forget the most memory that has been taken so far; where the system cannot, the peak is that of all calls."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
