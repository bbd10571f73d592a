"""``python -m tests.diagnosis.blind.contrasts CLIPS [lengths]``: which components does the prior need?

Snapshots of real clips are recorded by known virtual cameras. The better the prior, the likelier it makes them by the
true camera. Contrasts of statistics of video are measured behind eight slots and written to
docs/results/blind-contrasts.json; with ``lengths``, lengths of texture of smooth scenes, behind more slots than
statistics of video reach over, and what a camera without any mask lacks, to docs/results/blind-lengths.json.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.data.reader import find_clips
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import BLOCK, ScenePrior
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.prior.prior import smooth_scene_prior
from tests.diagnosis.blind.validation import record
from tests.measurements_file import MeasurementsFile

CONTRASTS = ((1.0,), (0.25, 1.0, 4.0), (0.1, 1.0, 10.0), (0.1, 0.3, 1.0, 3.0), (0.06, 0.25, 1.0, 4.0, 16.0))
"""Variances of patches over those of many videos."""
LENGTHS = ((3.0, 10.0), (2.0, 8.0), (1.5, 10.0), (1.5, 6.0), (1.0, 5.0), (1.5, 4.0, 10.0))
"""Pixels over which texture is alike."""
CAMERAS = ("none", "none", "mask_shift", "mask_blur", "none", "mask_contrast")
"""What is hidden in the camera of each set of eight snapshots, and known here."""
SIDE, SLOTS, MANY_SLOTS = 64, 8, 20
TITLES = {
    "contrasts": "factors on the variance of a patch",
    "lengths": "pixels over which texture is alike",
    "nats": "nats per pixel, by the true camera",
    "lacks": "nats per pixel that a camera without any mask lacks: mean",
    "least": "least",
}


def nats_per_pixel(captures: Captures, truth: dict[str, dict[str, Any]], prior: ScenePrior) -> tuple[float, float]:
    """Return how likely a prior makes snapshots by the true camera, and what the same without any mask lacks."""
    observation = observe_snapshots(captures)
    likelihood = BlindLikelihood(CameraModel(observation, vocabulary(), {}), prior)
    hypothesis = datasheet_noise(observation)[0]
    for name, values in truth.items():
        hypothesis = hypothesis.with_effect(name, values)
    without = hypothesis.with_effect("mask_contrast", {"leak": 1.0})
    true, even = (float(likelihood.evaluate(one).log_likelihood.nanmean()) / BLOCK**2 for one in (hypothesis, without))
    return true, true - even


def main(clips: Path, what: str = "contrasts") -> None:
    many = what == "lengths"
    slots, word = (MANY_SLOTS, " lengths") if many else (SLOTS, "")
    file = MeasurementsFile(
        Path(f"docs/results/blind-{what}.json"),
        machine="one thread",
        scale=f"{len(CAMERAS)} cameras, eight snapshots of {SIDE} x {SIDE} pixels each, {slots} slots, real clips",
        seeds=f"1 to {len(CAMERAS)}",
        command=f"python -m tests.diagnosis.blind.contrasts CLIPS{word}",
    )
    recorded = [record(find_clips(clips), hidden, SIDE, seed, slots) for seed, hidden in enumerate(CAMERAS, 1)]
    rows: list[dict[str, Any]] = []
    for choice in LENGTHS if many else CONTRASTS:
        statistics = smooth_scene_prior(slots, lengths=choice) if many else None
        prior = ScenePrior(slots, statistics) if many else ScenePrior(slots, contrasts=choice)
        nats, lacks = zip(*(nats_per_pixel(*one, prior) for one in recorded), strict=True)
        row = {what: ", ".join(f"{one:g}" for one in choice), "nats": sum(nats) / len(nats)}
        rows.append(row | {"lacks": sum(lacks) / len(lacks), "least": min(lacks)})
        print(rows[-1], flush=True)
        file.write([(key, TITLES[key], None if key == what else 3) for key in rows[0]], rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
