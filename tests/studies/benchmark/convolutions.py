"""``python -m tests.studies.benchmark.convolutions [FILE.json]``: ways of computing a convolution over time.

The results are what :func:`~sci_lightning.decoder.layers.convolution.fastest_way` chooses by. One thread, processor
time, the fastest of three calls, in GFLOP/s with two operations per multiply-accumulate of the definition.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from sci_lightning.decoder.layers.convolution import WAYS, fastest_way
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.runs.precision import multiplies_bfloat16
from tests.measurements_file import Column, MeasurementsFile

Shape = tuple[int, int, tuple[int, int, int], int]

SHAPES: Sequence[Shape] = (
    (32, 32, (3, 3, 3), 32),
    (32, 32, (3, 3, 3), 64),
    (64, 64, (3, 3, 3), 64),
    (96, 96, (3, 3, 3), 64),
    (96, 96, (1, 3, 3), 64),
    (192, 192, (1, 1, 1), 64),
    (16, 32, (3, 3, 3), 128),
    (64, 1, (3, 3, 3), 128),
)
"""Inputs, outputs, taps and side of features of eight frames, as the networks have them at 128 x 128 or 64 x 64."""

NAMES = {torch.float32: "float32", torch.bfloat16: "bfloat16"}


@torch.no_grad()
def measure(shape: Shape, dtype: torch.dtype, calls: int = 2) -> dict[str, Any]:
    """Return one row of the table: the speed of every way that can compute a convolution, and the way that is chosen.

    Args:
        shape: one of :data:`SHAPES`.
        dtype: float32 or bfloat16.
        calls: timed calls of every way.
    """
    inputs, outputs, taps, side = shape
    x = channels_last(torch.randn(1, inputs, 8, side, side, dtype=dtype))
    weight, bias = torch.randn(outputs, inputs, *taps, dtype=dtype) / 30, torch.randn(outputs, dtype=dtype)
    chosen = fastest_way(x, weight, 1)
    row: dict[str, Any] = {
        "shape": f"{inputs} to {outputs}, {' x '.join(map(str, taps))}, {side} x {side}",
        "type": NAMES[dtype],
        "chosen": chosen,
    }
    for name, way in WAYS.items():
        impossible = {"winograd": dtype != torch.float32 or taps[1:] != (3, 3), "frames": taps[0] > 1}
        if impossible.get(name):
            continue
        seconds = min(_seconds(partial(way, x, weight, bias, 1)) for _ in range(calls + 1))
        row[name] = 2e-9 * weight.numel() * x[0, 0].numel() / seconds
    return row


def _seconds(work: Callable[[], Any]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def main(arguments: Sequence[str]) -> None:
    """Measure all shapes in the precisions that the processor multiplies, print the rows, and write them."""
    torch.set_num_threads(1)
    described = {"scale": "convolutions of the networks", "seeds": "0"}
    command = "python -m tests.studies.benchmark.convolutions"
    file = MeasurementsFile(
        Path(arguments[0] if arguments else os.devnull), machine="one core", command=command, **described
    )
    dtypes = NAMES if multiplies_bfloat16(torch.device("cpu")) else {torch.float32: ""}
    rows = []
    for shape in SHAPES:
        for dtype in dtypes:
            rows.append(measure(shape, dtype))
            figures = (f"{key} {value:.0f}" if isinstance(value, float) else value for key, value in rows[-1].items())
            print(", ".join(figures))
    columns: list[Column] = [(key, key, None) for key in ("shape", "type", "chosen")]
    columns += [(name, name.replace("_", " "), 0) for name in WAYS]
    note = "GFLOP/s of one thread's processor time, two operations per multiply-accumulate; the fastest call."
    file.write(columns, rows, [note])


if __name__ == "__main__":
    main(sys.argv[1:])
