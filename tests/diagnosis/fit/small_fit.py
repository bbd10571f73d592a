"""A fit of what the virtual camera hides."""

from __future__ import annotations

from pathlib import Path

import sci_lightning.encoder.effects as effects
from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.virtual_camera import Session, VirtualCamera

VOCABULARY = {effect.name: effect for name in effects.__all__ if hasattr(effect := getattr(effects, name), "name")}

NOISE = Hypothesis({"shot_noise": {"full_well": 1e4}, "read_noise": {"std": 0.8}})


def fitter(folder: Path, hidden: dict[str, dict[str, float]]) -> Fitter:
    VirtualCamera(Session(size=(64, 64)), hidden).write(folder / "a.h5", seed=3)
    observation = observe(read_captures(folder / "a.h5"))
    return Fitter(CameraModel(observation, VOCABULARY), split(observation))
