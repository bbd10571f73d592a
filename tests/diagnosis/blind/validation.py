"""``python -m tests.diagnosis.blind.validation CLIPS OUT [SIDE] [ROUNDS] [pairs]``: is a blind diagnosis right?

In each round every effect of modulator and relay is hidden once, clearly, in a virtual camera that records eight
snapshots of real clips, eight slots long; twice nothing is hidden. With ``pairs`` two effects are hidden at a time. A
case leaves a record in OUT, and the same command goes on where it was interrupted. A name counts as right if its class,
the names that the snapshots cannot tell from it, holds what is hidden. It writes
docs/results/blind-validation-SIDE.json or blind-validation-pairs-SIDE.json.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.captures import Captures
from sci_lightning.data.reader import find_clips, read_clip
from sci_lightning.virtual_camera import Session
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hidden_effects import choose_effects
from sci_lightning.virtual_camera.session import Acquisition, World
from tests.diagnosis.blind.trials import COLUMNS, Trial, diagnosed, ran, row, rows
from tests.diagnosis.blind.true_camera import judged_by_truth
from tests.measurements_file import MeasurementsFile

HIDDEN = (
    "mask_shift",
    "mask_blur",
    "mask_rotation",
    "mask_scale",
    "mask_contrast",
    "mask_lag",
    "mask_keystone",
    "mask_distortion",
    "mask_orientation",
    "pattern_order",
    "none",
    "none",
)
"""What is hidden in the cases of a round."""
FITTED_WITH_POSE = " + "
PAIRS = (
    "mask_shift + mask_blur",
    "mask_rotation + mask_contrast",
    "mask_scale + mask_blur",
    "mask_shift + mask_rotation",
    "pattern_order + mask_blur",
    "mask_keystone + mask_contrast",
    "mask_orientation + mask_shift",
    "mask_distortion + mask_blur",
    "mask_rotation + mask_scale",
    "mask_shift + mask_contrast",
)
"""The same of pairs: every effect that is named by itself, with others."""
ALL = "all effects"
SNAPSHOTS, SLOTS, BEYOND = 8, 8, 12
"""Of a case; pixels of the scene on every side beyond the field."""


def record(
    clips: list[Path], hidden: str | Mapping[str, Mapping[str, float]], side: int, seed: int, slots: int = SLOTS
) -> tuple[Captures, dict[str, dict[str, Any]]]:
    """Return snapshots of pieces of real clips, and the parameters of what is hidden.

    Args:
        clips: of scenes.
        hidden: ``none``, names of effects whose parameters are drawn (:data:`FITTED_WITH_POSE` stands between them), or
            parameters by the names of effects.
        side: of a snapshot, pixels.
        seed: of everything random.
        slots: of a snapshot.
    """
    silent = dict.fromkeys(("dark", "flat", "all_on", "all_off", "pattern", "static", "dynamic"), 0)
    mask = ("binary", "structural")[seed % 2]
    session = Session(size=(side, side), frames=slots, mask=mask, unknown=SNAPSHOTS, oversampling=4, **silent)
    planned, random = session.acquisition(seed), np.random.default_rng(seed + 1000)
    whole = side + 2 * BEYOND
    scene = np.empty((SNAPSHOTS, slots, whole, whole), np.float32)
    for number in range(SNAPSHOTS):
        clip = read_clip(clips[(number + seed) % len(clips)])
        first, row, column = (
            int(random.integers(0, length - part + 1))
            for length, part in zip(clip.shape, (slots, whole, whole), strict=True)
        )
        piece = clip[first : first + slots, row : row + whole, column : column + whole]
        scene[number] = piece / (255 if clip.dtype == np.uint8 else 1)
    inside = (..., slice(BEYOND, -BEYOND), slice(BEYOND, -BEYOND))
    acquisition = Acquisition(
        planned.patterns,
        planned.sequence,
        scene[inside],
        planned.aperture,
        planned.exposure,
        planned.kind,
        World(BEYOND, planned.world.patterns, scene),
    )
    names = hidden.split(FITTED_WITH_POSE) if isinstance(hidden, str) and hidden != "none" else []
    effects = choose_effects(names if isinstance(hidden, str) else hidden, session, seed)
    captures = Captures(
        patterns=planned.patterns,
        sequence=planned.sequence,
        measurement=Camera(session, effects, seed).record(acquisition),
        scene=np.full((SNAPSHOTS, slots, side, side), np.nan, np.float32),
        aperture=planned.aperture,
        exposure=planned.exposure,
        kind=("unknown",) * SNAPSHOTS,
        bit_depth=session.bit_depth,
        read_noise_dn=session.read_noise_dn,
        full_well_e=session.full_well_e,
        name="snapshots of real clips",
    )
    return captures, {name: dict(effect.values) for name, effect in effects.items()}


def case(clips: list[Path], trial: Trial) -> dict[str, Any]:
    """Diagnose one case, and find out which effects that were missed are clear if the search begins with the truth."""
    seed = zlib.crc32(f"blind {trial.hidden} {trial.number}".encode()) % 100_000
    captures, truth = record(clips, trial.hidden, trial.side, seed)
    said = diagnosed(captures, truth)
    missed = [name for name in truth if name not in {effect["name"] for effect in said["named"]}]
    return {**said, "clear_by_truth": [name for name in missed if judged_by_truth(captures, truth, name).clear]}


def main(clips: Path, out: Path, side: int, rounds: int, pairs: bool) -> None:
    every = PAIRS if pairs else HIDDEN
    kind, word = ("pairs-", " pairs") if pairs else ("", "")
    file = MeasurementsFile(
        Path(f"docs/results/blind-validation-{kind}{side}.json"),
        machine="one thread",
        scale=f"eight snapshots of {side} x {side} pixels, eight slots, binary and structural masks, real clips",
        seeds="one of its own in every case",
        command=f"python -m tests.diagnosis.blind.validation CLIPS OUT {side} {rounds}{word}",
    )
    trials = [Trial(every[number % len(every)], number, side) for number in range(rounds * len(every))]
    cases = ran(partial(case, find_clips(clips)), trials, out)
    file.write(COLUMNS, [*rows(cases), row(ALL, [one for one in cases if one.truth])])


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[3:] if word != "pairs"]
    main(Path(sys.argv[1]), Path(sys.argv[2]), *[*numbers, *(64, 1)[len(numbers) :]], pairs="pairs" in sys.argv)
