"""Snapshots of smooth scenes, and their likelihood."""

from __future__ import annotations

import numpy as np

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary

SIZE, FRAMES, COUNT = 32, 3, 4


def snapshots(seed: int = 0, brightness: float = 1.0) -> Captures:
    """Return snapshots of smooth scenes behind random masks."""
    random = np.random.default_rng(seed)
    patterns = random.integers(0, 2, (FRAMES, SIZE, SIZE)).astype(np.float32)
    y, x = np.indices((SIZE, SIZE)) / SIZE
    phase = random.uniform(0, 6, (COUNT, FRAMES, 1, 1))
    scene = 0.3 + 0.2 * np.sin(5 * x + phase) * np.cos(4 * y + phase)
    light = brightness * (patterns * scene).sum(1) / 2
    dn = np.floor(255 * (light + random.normal(0, 0.002, light.shape)).clip(0, 1) + 0.5).astype(np.uint8)
    return Captures(
        patterns,
        np.tile(np.arange(FRAMES), (COUNT, 1)),
        dn,
        np.full((COUNT, FRAMES, SIZE, SIZE), np.nan, np.float32),
        np.ones(COUNT, np.float32),
        np.ones(COUNT, np.float32),
        ("unknown",) * COUNT,
        8,
        name="test",
    )


def likelihood_of(captures: Captures) -> tuple[BlindLikelihood, Hypothesis]:
    observation = observe_snapshots(captures)
    model = CameraModel(observation, vocabulary(), {})
    return BlindLikelihood(model, ScenePrior(FRAMES)), datasheet_noise(observation)[0]
