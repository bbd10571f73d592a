"""One camera, one calibration, one captures file (format_version 1) and the truth beside it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.textbook_camera.camera import MARGIN, MIRROR_MARGIN, SAMPLES, SLOTS, STEPS, Camera, Datasheet, plan
from tests.textbook_camera.light import Bench
from tests.textbook_camera.sensor import read_out
from tests.textbook_camera.targets import make, views


def mirror_patterns(datasheet: Datasheet, size: int, rng: np.random.Generator) -> np.ndarray:
    """Return the commands of all mirrors: ``SLOTS`` random patterns, then all off and all on; ``(SLOTS + 2, M, M)``."""
    mirrors = size + 2 * MIRROR_MARGIN
    levels = 15 if datasheet.gray else 1
    coding = rng.integers(0, levels + 1, (SLOTS, mirrors, mirrors)) / levels
    return np.concatenate([coding, np.zeros((1, mirrors, mirrors)), np.ones((1, mirrors, mirrors))])


def pixel_means(samples: np.ndarray, size: int) -> np.ndarray:
    """Return the means over the field's pixels, ``(..., size, size)``, of ``(..., n, n)`` samples."""
    inside = samples[..., MARGIN * SAMPLES : -MARGIN * SAMPLES, MARGIN * SAMPLES : -MARGIN * SAMPLES]
    return inside.reshape(*inside.shape[:-2], size, SAMPLES, size, SAMPLES).mean((-3, -1))


def capture(camera: Camera, datasheet: Datasheet, seed: int, size: int, name: str) -> dict[str, Any]:
    """Return the datasets and, under ``attributes``, the attributes of a captures file of this camera.

    ``size`` is the field's side in pixels, a multiple of 16 (the blocks of the phased reset). The same seed draws the
    same patterns, targets and photon arrivals whatever deviates; the captures are taken in a random order, as they
    should be where a source may drift.
    """
    if size % 16:
        raise ValueError(f"size is {size}; it is to be a multiple of 16, the number of blocks of a phased reset")
    patterns_rng, targets_rng, print_rng, bench_rng, maps_rng, noise_rng, order_rng = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(7)
    )
    patterns = mirror_patterns(datasheet, size, patterns_rng)
    bench = Bench(camera, patterns, size, bench_rng)
    shots = [plan()[index] for index in order_rng.permutation(len(plan()))]
    jitter = 1.0 + camera.jitter * order_rng.standard_normal(len(shots))
    jitter *= 1.0 + camera.drift * (np.arange(len(shots)) / (len(shots) - 1) - 0.5)
    targets = {
        name: make(name, camera, size, targets_rng, print_rng) for name in sorted({shot.target for shot in shots})
    }
    light, scenes = np.empty((len(shots), size, size)), np.empty((len(shots), SLOTS, size, size), np.float32)
    for index, shot in enumerate(shots):
        nominal, standing = views(targets[shot.target], camera, bench.steps)
        light[index] = shot.aperture * jitter[index] * pixel_means(bench.expose(shot.sequence, standing), size)
        frames = pixel_means(nominal, size)
        scenes[index] = (
            frames if len(frames) == 1 else frames[: SLOTS * STEPS].reshape(SLOTS, STEPS, size, size).mean(1)
        )
    field = slice(MIRROR_MARGIN, MIRROR_MARGIN + size)
    return {
        "patterns": patterns[:, field, field].astype(np.float32),
        "sequence": np.array([shot.sequence for shot in shots], np.int64),
        "measurement": read_out(camera, datasheet, light, maps_rng, noise_rng),
        "scene": scenes,
        "aperture": np.array([shot.aperture for shot in shots], np.float32),
        "exposure": np.ones(len(shots), np.float32),
        "kind": np.array([shot.kind for shot in shots], object),
        "attributes": {
            "format": "sci-captures",
            "format_version": 1,
            "bit_depth": datasheet.bit_depth,
            "read_noise_dn": datasheet.read_noise_dn,
            "full_well_e": datasheet.full_well_e,
            "name": name,
        },
    }


def _atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call ``write`` with a temporary path in the same folder, then give the file its name."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def save(path: Path, contents: dict[str, Any], truth: dict[str, Any]) -> None:
    """Write the captures file, and beside it, with the suffix ``.truth.json``, what was hidden in it."""

    def write(temporary: Path) -> None:
        with h5py.File(temporary, "w") as file:
            for name, value in contents.items():
                if name == "attributes":
                    file.attrs.update(value)
                elif name == "kind":
                    file.create_dataset(name, data=value, dtype=h5py.string_dtype())
                else:
                    file.create_dataset(name, data=value, compression="gzip", compression_opts=1)

    path.parent.mkdir(parents=True, exist_ok=True)
    _atomically(path, write)
    text = json.dumps(truth, indent=1) + "\n"
    _atomically(path.with_suffix(".truth.json"), lambda temporary: temporary.write_text(text))
