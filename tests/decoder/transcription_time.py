"""``python -m tests.decoder.transcription_time SIDE JSON NAME ..``: networks in turns with their plain transcriptions.

Both decode the same snapshot of T = 8 with the same random weights, in float32 and in bfloat16, on an idle machine.
"""

from __future__ import annotations

import os
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

import sci_lightning as sci
from sci_lightning.runs.precision import mixed_precision
from sci_lightning.studies.benchmark.timing import seconds_in_turns, times_as_fast
from tests.decoder.transcriptions import TRANSCRIPTIONS, as_published
from tests.measurements_file import MeasurementsFile

COLUMNS = [
    ("network", "network", None),
    ("precision", "precision", None),
    ("plain", "plain transcription (s)", 3),
    ("ours", "ours (s)", 3),
    ("gain", "times as fast", 2),
]


def main(side: int, out: Path, names: Sequence[str]) -> None:
    """Write the median seconds of both, and the median of their ratio."""
    file = MeasurementsFile(
        out,
        machine=f"cpu ({torch.get_num_threads()} of {os.cpu_count()} threads)",
        scale=f"full networks, one snapshot at {side} x {side}, T = 8; the median of up to 7 pairs",
        seeds="0",
        command=f"python -m tests.decoder.transcription_time {side} {out} {' '.join(names)}",
    )
    rows = []
    for name in names:
        torch.manual_seed(0)
        decoder, plain = sci.load_decoder(name, ["frames=8"]), TRANSCRIPTIONS[name]
        mask = (torch.rand(8, side, side) < 0.5).float()
        measurement, weights = (mask * torch.rand(8, side, side)).sum(0, keepdim=True), as_published(decoder)
        calls = {
            "ours": lambda: decoder(measurement, mask),  # noqa: B023, called within this turn of the loop
            "plain": lambda: plain(weights, measurement, mask),  # noqa: B023
        }
        for precision, shown in (("32-true", "float32"), ("bf16-mixed", "bfloat16")):
            with torch.inference_mode(), mixed_precision(precision, torch.device("cpu")):
                seconds = seconds_in_turns(calls, torch.device("cpu"), 1, 7, 60)
            medians = {key: statistics.median(values) for key, values in seconds.items()}
            gain = times_as_fast(seconds["ours"], seconds["plain"])
            rows.append({"network": name, "precision": shown, **medians, "gain": gain})
            print(rows[-1], flush=True)
    file.write(COLUMNS, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
