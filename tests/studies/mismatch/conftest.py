"""A small bench: three snapshots of moving textures in front of cameras of 32 x 32 pixels and four slots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.data.source import Scene
from sci_lightning.studies.mismatch.bench import Bench, prepare_bench
from sci_lightning.virtual_camera.scene import textured_scene

PUBLISHED = {
    "mask_shift": {"dx": 1.5, "dy": 1.0},
    "mask_rotation": {"angle": 0.3},
    "mask_blur": {"sigma": 0.3},
    "sync_offset": {"offset": 0.08},
    "duty_cycle": {"fraction": 0.92},
    "gain": {"factor": 1.05},
    "black_level": {"offset": 0.005},
}
DATASHEET = {"bit_depth": 12, "full_well_e": 10000, "read_noise_dn": 5}
FEW = {"dark": 2, "flat": 2, "all_on": 1, "all_off": 1, "pattern": None, "static": 2, "dynamic": 2}


def made_scenes(frames: int = 4, size: int = 32) -> list[Scene]:
    """Two scenes, of one and of two snapshots."""
    videos = [textured_scene(np.random.default_rng(number), (size, size), frames, moving=True) for number in range(3)]
    return [Scene("one", torch.from_numpy(videos[0])[None]), Scene("two", torch.from_numpy(np.stack(videos[1:])))]


def made_bench(folder: Path, **changed: object) -> Bench:
    """The bench, with some of its settings changed."""
    settings: dict[str, object] = {"mask": None, "middle": None, "aperture": None, "seed": 0}
    settings |= {"datasheet": DATASHEET, "calibration": FEW}
    bench = prepare_bench(made_scenes(), folder, **{**settings, **changed})  # type: ignore[arg-type]
    bench.write_patterns()
    return bench


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return made_bench(tmp_path)
