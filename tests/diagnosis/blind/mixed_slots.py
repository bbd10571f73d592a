"""``python -m tests.diagnosis.blind.mixed_slots CLIPS``: from which strength on do snapshots show a lag or a delay?

A mask that lags, and patterns that come late, mix every slot with its neighbour. A scene that moves a little less does
the same to a snapshot, so that a weak mixture may remain unseen. Cameras with one such effect record snapshots of real
clips; the effect is fitted from its true value and judged as a search would judge it. What was measured is written to
docs/results/blind-mixed-slots.json.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.data.reader import find_clips
from tests.diagnosis.blind.true_camera import judged_by_truth
from tests.diagnosis.blind.validation import record
from tests.measurements_file import MeasurementsFile

STRENGTHS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
"""Part of a slot that shows the pattern before."""
EFFECTS = {"mask_lag": "lag", "sync_offset": "offset"}
"""What is hidden, and its parameter."""
SEEDS = (1, 2, 3, 4, 5, 6)
SIDE = 128
COLUMNS: list[tuple[str, str, int | None]] = [
    ("effect", "hidden", None),
    ("strength", "part of a slot", 2),
    ("clear", "clear enough to be named", None),
    ("least", "calibrated nats, least", 1),
    ("median", "median", 1),
    ("most", "most", 1),
    ("error", "error of the strength, root mean square", 3),
]


def judged(clips: list[Path], effect: str, strength: float, seed: int) -> tuple[bool, float, float]:
    """Return whether an effect that is hidden by itself is clear, its calibrated nats, and its fitted strength."""
    captures, truth = record(clips, {effect: {EFFECTS[effect]: strength}}, SIDE, seed)
    candidate = judged_by_truth(captures, truth, effect)
    return candidate.clear, candidate.nats, float(candidate.fit.hypothesis.effects[effect][EFFECTS[effect]])


def main(clips: Path) -> None:
    file = MeasurementsFile(
        Path("docs/results/blind-mixed-slots.json"),
        machine="one thread",
        scale=f"{len(SEEDS)} cameras a row, eight snapshots of {SIDE} x {SIDE} pixels each, eight slots, real clips",
        seeds=f"{SEEDS[0]} to {SEEDS[-1]}",
        command="python -m tests.diagnosis.blind.mixed_slots CLIPS",
    )
    found, rows = find_clips(clips), list[dict[str, Any]]()
    for effect in EFFECTS:
        for strength in STRENGTHS:
            clear, nats, fitted = zip(*(judged(found, effect, strength, seed) for seed in SEEDS), strict=True)
            errors = np.array(fitted) - strength
            rows.append(
                {
                    "effect": effect,
                    "strength": strength,
                    "clear": f"{sum(clear)} of {len(SEEDS)}",
                    "least": min(nats),
                    "median": float(np.median(nats)),
                    "most": max(nats),
                    "error": float(np.sqrt((errors**2).mean())),
                }
            )
            print(rows[-1], flush=True)
            file.write(COLUMNS, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
