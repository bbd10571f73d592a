"""``python -m tests.diagnosis.blind.validation CLIPS CASES.jsonl [SIDE] [ROUNDS] [pairs]``: is a blind diagnosis right?

In each round every effect of modulator and relay is hidden once, clearly, in a virtual camera that records eight
snapshots of real clips, eight slots long; twice nothing is hidden. With ``pairs`` two effects are hidden at a time. A
case is a line of CASES.jsonl once it is done, and the same command goes on where it was interrupted. It writes
docs/results/blind-validation-SIDE.json or blind-validation-pairs-SIDE.json.
"""

from __future__ import annotations

import json
import sys
import time
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.captures import Captures
from sci_lightning.data.reader import find_clips, read_clip
from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from sci_lightning.studies.proving_ground.summary import Proportion
from sci_lightning.virtual_camera import Session
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hidden_effects import choose_effects
from sci_lightning.virtual_camera.session import Acquisition, World
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
    clips: list[Path], hidden: str | Mapping[str, Mapping[str, float]], side: int, seed: int
) -> tuple[Captures, dict[str, dict[str, Any]]]:
    """Return snapshots of pieces of real clips, and the parameters of what is hidden.

    Args:
        clips: of scenes.
        hidden: ``none``, names of effects whose parameters are drawn (:data:`FITTED_WITH_POSE` stands between them), or
            parameters by the names of effects.
        side: of a snapshot, pixels.
        seed: of everything random.
    """
    silent = dict.fromkeys(("dark", "flat", "all_on", "all_off", "pattern", "static", "dynamic"), 0)
    mask = ("binary", "structural")[seed % 2]
    session = Session(size=(side, side), frames=SLOTS, mask=mask, unknown=SNAPSHOTS, oversampling=4, **silent)
    planned, random = session.acquisition(seed), np.random.default_rng(seed + 1000)
    whole = side + 2 * BEYOND
    scene = np.empty((SNAPSHOTS, SLOTS, whole, whole), np.float32)
    for number in range(SNAPSHOTS):
        clip = read_clip(clips[(number + seed) % len(clips)])
        first, row, column = (
            int(random.integers(0, length - part + 1))
            for length, part in zip(clip.shape, (SLOTS, whole, whole), strict=True)
        )
        piece = clip[first : first + SLOTS, row : row + whole, column : column + whole]
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
        scene=np.full((SNAPSHOTS, SLOTS, side, side), np.nan, np.float32),
        aperture=planned.aperture,
        exposure=planned.exposure,
        kind=("unknown",) * SNAPSHOTS,
        bit_depth=session.bit_depth,
        read_noise_dn=session.read_noise_dn,
        full_well_e=session.full_well_e,
        name="snapshots of real clips",
    )
    return captures, {name: dict(effect.values) for name, effect in effects.items()}


def case(clips: list[Path], hidden: str, side: int, number: int) -> dict[str, Any]:
    """Diagnose one case, and find out which effects that were missed are clear if the search begins with the truth."""
    seed = zlib.crc32(f"blind {hidden} {number}".encode()) % 100_000
    captures, truth = record(clips, hidden, side, seed)
    start = time.process_time()
    diagnosis = diagnose_blind(captures)
    named = {
        effect.name: {key: (one.value, one.std) for key, one in effect.parameters.items()}
        for effect in diagnosis.effects
    }
    alternatives = {effect.name: effect.alternatives for effect in diagnosis.effects}
    seconds = time.process_time() - start
    missed = [name for name in truth if name not in named]
    clear = [name for name in missed if judged_by_truth(captures, truth, name).clear]
    about = {"hidden": hidden, "number": number, "side": side, "seed": seed, "truth": truth, "named": named}
    return {
        **about,
        "alternatives": alternatives,
        "verdict": diagnosis.verdict,
        "cpu_seconds": seconds,
        "clear_by_truth": clear,
    }


def inside(truth: dict[str, Any], named: dict[str, Any]) -> list[bool]:
    """Return of every number of effects that were rightly named whether its 95 % interval holds the truth."""
    held = []
    for name in truth.keys() & named.keys():
        for key, true in truth[name].items():
            value, std = named[name].get(key, (None, 0.0))
            if isinstance(true, float) and isinstance(value, float) and std > 0:
                held.append(abs(value - true) < 1.96 * std)
    return held


def summary(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for everything that was hidden, and one for all."""
    rows = []
    effects = [one for one in cases if one["hidden"] != "none"]
    groups = [(name, [one for one in cases if one["hidden"] == name]) for name in dict.fromkeys((*HIDDEN, *PAIRS))]
    for title, group in [*groups, (ALL, effects)]:
        if group:
            right = [one for one in group if set(one["named"]) == set(one["truth"])]
            wrong = [one for one in group if set(one["named"]) - set(one["truth"])]
            held = [each for one in group for each in inside(one["truth"], one["named"])]
            instead = sorted({", ".join(sorted(one["named"])) or "nothing" for one in group if one not in right})
            rows.append(
                {
                    "hidden": title,
                    "right": _text(Proportion(len(right), len(group))),
                    "wrong": _text(Proportion.of(one in wrong and one["verdict"] == "explained" for one in group)),
                    "held": f"{sum(held)} of {len(held)}" if held else "",
                    "instead": "; ".join(instead) if title != ALL else "",
                    "clear": _clear(group),
                    "seconds": float(np.median([one["cpu_seconds"] for one in group])),
                }
            )
    return rows


def _clear(group: list[dict[str, Any]]) -> str:
    """Return of how many effects that were missed the snapshots tell enough."""
    missed = sum(len(set(one["truth"]) - set(one["named"])) for one in group)
    return f"{sum(len(one['clear_by_truth']) for one in group)} of {missed}" if missed else ""


def _text(proportion: Proportion) -> str:
    low, high = (round(100 * end) for end in proportion.interval)
    return f"{proportion.count} of {proportion.total} ({low} % to {high} %)"


def main(clips: Path, out: Path, side: int, rounds: int, pairs: bool) -> None:
    found, every = find_clips(clips), PAIRS if pairs else HIDDEN
    kind, word = ("pairs-", " pairs") if pairs else ("", "")
    file = MeasurementsFile(
        Path(f"docs/results/blind-validation-{kind}{side}.json"),
        machine="one thread",
        scale=f"eight snapshots of {side} x {side} pixels, eight slots, binary and structural masks, real clips",
        seeds="one of its own in every case",
        command=f"python -m tests.diagnosis.blind.validation CLIPS CASES.jsonl {side} {rounds}{word}",
    )
    done = [json.loads(line) for line in out.read_text().splitlines()] if out.is_file() else []
    for number in range(rounds * len(every)):
        if not any(one["number"] == number and one["side"] == side for one in done):
            done.append(case(found, every[number % len(every)], side, number))
            with out.open("a") as stream:
                stream.write(json.dumps(done[-1]) + "\n")
            print(f"{number}: {done[-1]['hidden']} -> {', '.join(done[-1]['named']) or 'nothing'}", flush=True)
        columns: list[tuple[str, str, int | None]] = [
            ("hidden", "hidden", None),
            ("right", "named, and nothing else", None),
            ("wrong", "a wrong name, `explained`", None),
            ("held", "95 % intervals that hold", None),
            ("instead", "named otherwise", None),
            ("clear", "missed, yet clear to a search that begins with the truth", None),
            ("seconds", "processor seconds", 0),
        ]
        file.write(columns, summary([one for one in done if one["side"] == side]))


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[3:] if word != "pairs"]
    main(Path(sys.argv[1]), Path(sys.argv[2]), *[*numbers, *(64, 1)[len(numbers) :]], pairs="pairs" in sys.argv)
