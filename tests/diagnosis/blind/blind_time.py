"""``python -m tests.diagnosis.blind.blind_time CLIPS [SIDE ..]``: how long a diagnosis from snapshots alone takes.

Eight snapshots of real clips behind a rotated mask, eight slots long, are diagnosed on all cores; the machine should be
idle. It writes docs/results/blind-time.json.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import torch

from sci_lightning.data.reader import find_clips
from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from tests.diagnosis.blind.validation import record
from tests.measurements_file import MeasurementsFile

SIDES = (64, 128, 232)
"""Sides of the field in pixels; the clips are 256 pixels high, and the world goes on beyond the field."""
RESULTS = Path("docs/results/blind-time.json")


def main(clips: Path, sides: list[int]) -> None:
    file = MeasurementsFile(
        RESULTS,
        machine=f"{torch.get_num_threads()} threads",
        scale="eight snapshots, eight slots, a binary mask that is rotated, real clips",
        seeds="2",
        command="python -m tests.diagnosis.blind.blind_time CLIPS",
    )
    rows = []
    for side in sides:
        captures, _ = record(find_clips(clips), "mask_rotation", side, seed=2)
        start, processor = time.perf_counter(), time.process_time()
        diagnosis = diagnose_blind(captures)
        rows.append(
            {
                "field": f"{side} x {side}",
                "seconds": time.perf_counter() - start,
                "processor_seconds": time.process_time() - processor,
                "named": ", ".join(diagnosis.names),
            }
        )
        print(rows[-1], flush=True)
        columns: list[tuple[str, str, int | None]] = [
            ("field", "field", None),
            ("seconds", "seconds", 0),
            ("processor_seconds", "processor seconds", 0),
            ("named", "effects named", None),
        ]
        file.write(columns, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]), [int(side) for side in sys.argv[2:]] or list(SIDES))
