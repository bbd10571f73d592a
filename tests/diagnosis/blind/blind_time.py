"""``python -m tests.diagnosis.blind.blind_time CLIPS``: how long a diagnosis from snapshots alone takes.

Eight snapshots of real clips, eight slots long, are diagnosed on all cores; the machine should be idle. It writes
docs/results/blind-time.json.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import torch

from sci_lightning.data.reader import find_clips
from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from tests.diagnosis.blind.validation import record
from tests.measurements_file import Column, MeasurementsFile

ROTATED = {"mask_rotation": {"angle": 0.8}}
SEVERAL = {
    "mask_shift": {"dx": 1.5, "dy": 1.0},
    "mask_rotation": {"angle": 0.3},
    "mask_blur": {"sigma": 0.6},
    "black_level": {"offset": 0.02},
}
CASES = ((64, ROTATED), (128, ROTATED), (232, ROTATED), (232, SEVERAL))
"""Sides of the field in pixels, and what is hidden. Clips are 256 pixels high, and the world goes on beyond it."""
RESULTS = Path("docs/results/blind-time.json")


def main(clips: Path) -> None:
    file = MeasurementsFile(
        RESULTS,
        machine=f"{torch.get_num_threads()} threads",
        scale="eight snapshots, eight slots, a binary mask, real clips",
        seeds="2",
        command="python -m tests.diagnosis.blind.blind_time CLIPS",
    )
    rows = []
    for side, hidden in CASES:
        captures, _ = record(find_clips(clips), hidden, side, seed=2)
        start, processor = time.perf_counter(), time.process_time()
        diagnosis = diagnose_blind(captures)
        rows.append(
            {
                "field": f"{side} x {side}",
                "hidden": ", ".join(hidden),
                "seconds": time.perf_counter() - start,
                "processor_seconds": time.process_time() - processor,
                "named": ", ".join(diagnosis.names),
            }
        )
        print(rows[-1], flush=True)
        columns: list[Column] = [
            ("field", "field", None),
            ("hidden", "hidden", None),
            ("seconds", "seconds", 0),
            ("processor_seconds", "processor seconds", 0),
            ("named", "effects named", None),
        ]
        file.write(columns, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
