"""``python -m tests.diagnosis.blind.gliding_scenes OUT SEED [NOTHING EACH]``: fast scenes are the scene's.

Photographs glide behind the masks by up to three pixels a slot, faster than the clips from which the statistics of
scenes come. A camera of its own records them: it shares no code with the package, and light falls on it point by point.
NOTHING times nothing is hidden, EACH times each of a displacement, a blur, a rotation and another order of the
patterns; the seeds of the cases begin with SEED. What looks like motion must not be called a lag or a delay. A case
leaves a record in OUT, and the same command goes on where it ended. It writes docs/results/blind-gliding-SEED.json.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from skimage import data

from sci_lightning.captures import Captures
from tests.diagnosis.blind.trials import COLUMNS, Trial, diagnosed, ran, rows
from tests.measurements_file import MeasurementsFile

PHOTOGRAPHS = ("camera", "astronaut", "coffee", "chelsea", "rocket", "coins", "brick", "gravel", "grass", "moon")
"""Pictures that come with scikit-image."""
SNAPSHOTS, SLOTS, SIDE = 6, 8, 64
FINE, STEPS, BEYOND = 4, 4, 10
"""Points of a pixel along either axis, moments of a slot, and pixels of the world on every side beyond the field."""
FASTEST = 3.0
"""Pixels by which a scene glides in a slot; the slowest one glides by a third of that."""
FULL_WELL, READ_NOISE = 10000.0, 1.0
HIDDEN = ("nothing", "mask_shift", "mask_blur", "mask_rotation", "pattern_order")


def record(hidden: str, seed: int) -> tuple[Captures, dict[str, float]]:
    """Return six snapshots behind a random binary mask, and the parameters of the one effect that is hidden."""
    random = np.random.default_rng([seed, HIDDEN.index(hidden)])
    world = SIDE + 2 * BEYOND
    commanded = random.integers(0, 2, (SLOTS, world, world)).astype(np.float64)
    shown, truth = _imaged(commanded, hidden, random)
    dn = np.stack([_exposed(shown, _glide(random, world), random) for _ in range(SNAPSHOTS)])
    inner = slice(BEYOND, BEYOND + SIDE)
    captures = Captures(
        patterns=commanded[:, inner, inner].astype(np.float32),
        sequence=np.tile(np.arange(SLOTS), (SNAPSHOTS, 1)),
        measurement=dn,
        scene=np.full((SNAPSHOTS, SLOTS, SIDE, SIDE), np.nan, np.float32),
        aperture=np.full(SNAPSHOTS, 2 / SLOTS, np.float32),
        exposure=np.ones(SNAPSHOTS, np.float32),
        kind=("unknown",) * SNAPSHOTS,
        bit_depth=8,
        read_noise_dn=READ_NOISE,
        full_well_e=FULL_WELL,
        name=f"gliding photographs, {hidden}",
    )
    return captures, truth


def _imaged(commanded: np.ndarray, hidden: str, random: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
    """Return what every point of the world receives through the mask in every slot, and what is hidden."""
    if hidden == "pattern_order":
        offset = int(random.choice([-2, -1, 1, 2]))
        commanded, truth = np.roll(commanded, offset, 0), {"offset": float(offset)}
    fine = commanded.repeat(FINE, 1).repeat(FINE, 2)
    if hidden == "mask_shift":
        dx, dy = random.uniform(0.4, 2.5, 2) * random.choice([-1, 1], 2)
        truth = {"dx": round(float(dx) * FINE) / FINE, "dy": round(float(dy) * FINE) / FINE}
        fine = np.roll(fine, (round(truth["dy"] * FINE), round(truth["dx"] * FINE)), (1, 2))
    elif hidden == "mask_blur":
        truth = {"sigma": float(random.uniform(0.5, 0.9))}
        fine = np.stack([gaussian_filter(image, truth["sigma"] * FINE) for image in fine])
    elif hidden == "mask_rotation":
        truth = {"angle": float(random.uniform(0.6, 1.5) * random.choice([-1, 1]))}
        turn, places = np.deg2rad(truth["angle"]), np.indices(fine.shape[1:]) - (fine.shape[1] - 1) / 2
        y, x = np.cos(turn) * places[0] - np.sin(turn) * places[1], np.cos(turn) * places[1] + np.sin(turn) * places[0]
        middle = (fine.shape[1] - 1) / 2
        fine = np.stack([map_coordinates(image, (y + middle, x + middle), order=0, mode="nearest") for image in fine])
    return fine, truth if hidden != "nothing" else {}


def _glide(random: np.random.Generator, world: int) -> np.ndarray:
    """Return a photograph that glides, ``(slots, moments, world, world)`` in [0, 1]; between pixels it is linear."""
    picture = getattr(data, str(random.choice(PHOTOGRAPHS)))().astype(np.float64)
    picture = (picture if picture.ndim == 2 else picture[..., :3].mean(2)) / 255
    coarse = float(random.uniform(1.0, 2.0))  # pixels of the picture that a pixel of the camera covers
    picture = gaussian_filter(picture, 0.4 * coarse)
    speed, direction = random.uniform(FASTEST / 3, FASTEST), random.uniform(0, 2 * np.pi)
    step = speed * coarse * np.array([np.sin(direction), np.cos(direction)])
    reach = int(np.ceil(SLOTS * FASTEST * coarse)) + 1
    room = np.array(picture.shape) - int(np.ceil(world * coarse)) - 2 * reach
    corner = reach + random.random(2) * room.clip(min=0)
    y, x = np.indices((world, world)) * coarse
    moments = (np.arange(SLOTS * STEPS) + 0.5) / STEPS
    frames = [
        map_coordinates(picture, (y + corner[0] + step[0] * t, x + corner[1] + step[1] * t), order=1, mode="reflect")
        for t in moments
    ]
    return np.stack(frames).reshape(SLOTS, STEPS, world, world)


def _exposed(shown: np.ndarray, scene: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return the DN ``(H, W)`` of a snapshot: light is added up point by point, the world cut to the field."""
    passed = sum(mask * frame.mean(0).repeat(FINE, 0).repeat(FINE, 1) for mask, frame in zip(shown, scene, strict=True))
    light = 2 / SLOTS * np.asarray(passed).reshape(len(scene[0, 0]), FINE, -1, FINE).mean((1, 3))
    light = 0.8 * light[BEYOND:-BEYOND, BEYOND:-BEYOND]
    signal = random.poisson(light * FULL_WELL) / FULL_WELL + random.normal(0, READ_NOISE / 255, light.shape)
    return np.floor(255 * signal.clip(0, 1) + 0.5).astype(np.uint8)


def case(trial: Trial) -> dict[str, Any]:
    """Diagnose one case."""
    captures, truth = record(trial.hidden, trial.number)
    return diagnosed(captures, {trial.hidden: truth} if truth else {})


def main(out: Path, first: int, nothing: int = 20, each: int = 4) -> None:
    file = MeasurementsFile(
        Path(f"docs/results/blind-gliding-{first}.json"),
        machine="one thread",
        scale=f"{SNAPSHOTS} snapshots of {SIDE} x {SIDE} pixels, {SLOTS} slots, a binary mask, photographs that glide",
        seeds=f"from {first}",
        command=f"python -m tests.diagnosis.blind.gliding_scenes OUT {first} {nothing} {each}",
    )
    counts = {hidden: each if hidden != "nothing" else nothing for hidden in HIDDEN}
    trials = [Trial(hidden, first + number, SIDE) for hidden in HIDDEN for number in range(counts[hidden])]
    counted = [{key: value for key, value in row.items() if key != "clear"} for row in rows(ran(case, trials, out))]
    file.write([column for column in COLUMNS if column[0] != "clear"], counted)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *(int(word) for word in sys.argv[2:]))
