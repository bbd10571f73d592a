"""A graph beside the decoder that it was made of: how far their videos differ, and how long both take."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch

from sci_lightning.decoder import Decoder
from sci_lightning.decoder.onnx.graph import require
from sci_lightning.errors import MachineFailure
from sci_lightning.operator import SnapshotOperator

TOLERANCE = 1e-4
"""Largest difference of a pixel of the two videos, in units of the video or of its largest value if that is above 1."""

SIZES = ((48, 64), (50, 37), (64, 80))
"""(H, W) that a graph of any size is compared at: the one that torch was followed on, an odd one, a larger one."""


class OnnxDecoder:
    """A graph in onnxruntime on the CPU, called as the decoder is.

    Args:
        path: of the ONNX file.
        threads: of onnxruntime; None: as many as torch uses.
        mask: whether the mask is an input of the graph; else it is inside.

    Raises:
        BadInput: onnxruntime is not installed.
    """

    def __init__(self, path: Path, threads: int | None = None) -> None:
        require("onnxruntime")
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or torch.get_num_threads()
        options.log_severity_level = 3  # errors
        self.session: Any = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        self.takes_mask = len(self.session.get_inputs()) > 1

    def __call__(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the video ``(1, T, H, W)`` of a measurement ``(1, H, W)`` and a mask ``(T, H, W)``."""
        inputs: dict[str, np.ndarray] = {"measurement": measurement.numpy()}
        if self.takes_mask:
            inputs["mask"] = mask.numpy()
        return torch.from_numpy(self.session.run(["video"], inputs)[0])


def largest_difference(
    graph: OnnxDecoder, decoder: Decoder, frames: int, sizes: Sequence[Sequence[int]], mask: torch.Tensor | None = None
) -> float:
    """Return by how much the videos of a graph and its decoder differ, as :data:`TOLERANCE` counts it.

    Args:
        graph, decoder: the two.
        frames: T.
        sizes: (H, W) of the snapshots, one after another.
        mask: of all snapshots, if the graph holds it; None: random binary masks.

    Raises:
        MachineFailure: they differ by more than the tolerance, or in shape.
    """
    largest = 0.0
    for size in sizes:
        snapshot = random_snapshot(frames, size, mask)
        with torch.no_grad():
            video, expected = graph(*snapshot), decoder(*snapshot)
        if video.shape != expected.shape:
            raise MachineFailure(
                f"the graph's video is {tuple(video.shape)}, torch's {tuple(expected.shape)}; nothing was written"
            )
        difference = float((video - expected).abs().max() / expected.abs().max().clamp(min=1))
        if not difference <= TOLERANCE:
            raise MachineFailure(
                f"at {size[0]} x {size[1]} the graph's video differs from torch's by {difference:.1e}, more than "
                f"{TOLERANCE:.0e}; nothing was written"
            )
        largest = max(largest, difference)
    return largest


def seconds_of(
    decoders: Sequence[Callable[[torch.Tensor, torch.Tensor], torch.Tensor]],
    frames: int,
    size: Sequence[int],
    mask: torch.Tensor | None = None,
    repeats: int = 3,
) -> list[float]:
    """Return the median seconds of each decoder for one snapshot; they take turns, after one call each to warm up."""
    snapshot = random_snapshot(frames, size, mask)
    seconds: list[list[float]] = [[] for _ in decoders]
    with torch.no_grad():
        for _ in range(repeats + 1):
            for decoder, times in zip(decoders, seconds, strict=True):
                start = time.perf_counter()
                decoder(*snapshot)
                times.append(time.perf_counter() - start)
    return [median(times[1:]) for times in seconds]


def random_snapshot(
    frames: int, size: Sequence[int], mask: torch.Tensor | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return measurement ``(1, H, W)`` and mask ``(T, H, W)`` of a random video, always the same for one size."""
    generator = torch.Generator().manual_seed(0)
    if mask is None:
        mask = (torch.rand(frames, *size, generator=generator) < 0.5).float()
    return SnapshotOperator(mask)(torch.rand(1, *mask.shape, generator=generator)), mask
