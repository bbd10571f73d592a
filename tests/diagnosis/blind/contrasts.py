"""``python -m tests.diagnosis.blind.contrasts CLIPS``: how many contrasts does the prior of unknown scenes need?

Snapshots of real clips are recorded by known virtual cameras. The better the prior, the likelier it makes them by the
true camera. What was measured is written to docs/results/blind-contrasts.json.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from sci_lightning.data.reader import find_clips
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel, datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis.blind.validation import record
from tests.measurements_file import MeasurementsFile

CONTRASTS = ((1.0,), (0.25, 1.0, 4.0), (0.1, 1.0, 10.0), (0.1, 0.3, 1.0, 3.0), (0.06, 0.25, 1.0, 4.0, 16.0))
"""Variances of patches over those of many videos."""
CAMERAS = ("none", "none", "mask_shift", "mask_blur", "none", "mask_contrast")
"""What is hidden in the camera of each set of eight snapshots, and known here."""
SIDE = 64
RESULTS = Path("docs/results/blind-contrasts.json")


def main(clips: Path) -> None:
    file = MeasurementsFile(
        RESULTS,
        machine="one thread",
        scale=f"{len(CAMERAS)} cameras, eight snapshots of {SIDE} x {SIDE} pixels each, eight slots, validation clips",
        seeds=f"1 to {len(CAMERAS)}",
        command="python -m tests.diagnosis.blind.contrasts CLIPS",
    )
    recorded = [record(find_clips(clips), hidden, SIDE, seed) for seed, hidden in enumerate(CAMERAS, 1)]
    rows: list[dict[str, Any]] = []
    for contrasts in CONTRASTS:
        nats = []
        for captures, truth in recorded:
            observation = observe_snapshots(captures)
            likelihood = BlindLikelihood(
                CameraModel(observation, vocabulary(), {}), ScenePrior(observation.frames, contrasts=contrasts)
            )
            hypothesis = datasheet_noise(observation)[0]
            for name, values in truth.items():
                hypothesis = hypothesis.with_effect(name, values)
            nats.append(float(likelihood.evaluate(hypothesis).log_likelihood.nanmean()))
        rows.append({"contrasts": ", ".join(f"{one:g}" for one in contrasts), "nats": sum(nats) / len(nats)})
        print(rows[-1], flush=True)
        file.write(
            [
                ("contrasts", "factors on the variance of a patch", None),
                ("nats", "nats per block, by the true camera", 2),
            ],
            rows,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
