"""``python -m tests.decoder.linear_time JSON``: how long decoder=linear takes for a mask, and for a measurement then.

It writes the measurements from which the table in docs/explanation/linear-estimate.md is made. The machine should be
idle.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path
from typing import Any

import torch

from sci_lightning.decoder import Linear
from tests.measurements_file import MeasurementsFile

REPEATS = 12


@torch.no_grad()
def row(threads: int, mixture: bool) -> dict[str, Any]:
    """Time a decoder of its own behind a random binary mask of 256 x 256 pixels without a tile, T = 8."""
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    decoder, mask = Linear(mixture=mixture), (torch.rand(8, 256, 256) < 0.5).float()
    measurement = (torch.rand(1, 8, 256, 256) * mask).sum(1)
    seconds = []
    for _ in range(REPEATS + 1):
        began = time.perf_counter()
        decoder(measurement, mask)
        seconds.append(time.perf_counter() - began)
    first, *others = seconds
    milliseconds = 1e3 * statistics.median(others)
    prior = "a mixture (the default)" if mixture else "one Gaussian"
    return {"prior": prior, "threads": threads, "prepare": first - milliseconds / 1e3, "measurement": milliseconds}


def main(out: Path) -> None:
    file = MeasurementsFile(
        out,
        machine="two cores",
        scale="256 x 256, T = 8, a mask without a tile; the median of 12 measurements",
        seeds="0",
        command="python -m tests.decoder.linear_time docs/results/linear-time.json",
    )
    columns = [
        ("prior", "statistics", None),
        ("threads", "threads", 0),
        ("prepare", "to prepare a mask (s)", 1),
        ("measurement", "a measurement (ms)", 0),
    ]
    file.write(columns, [row(threads, mixture) for mixture in (True, False) for threads in (1, 2)])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
