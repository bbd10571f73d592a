"""The photograph of a micromirror device's letters, and the points by which a model of it is judged.

The fiducial points (clicked by hand on the letters) only judge: no registration and no fit sees them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy.io import loadmat
from scipy.optimize import fsolve

from sci_lightning.captures import Captures
from sci_lightning.captures.registration import Registration, register
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, datasheet_noise
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import MaskDistortion
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.imaging.homography import of_binned_field

REGISTERED, FITTED = 4, 16
"""Pixels of the photograph along the side of a pixel that is registered, and of one that is fitted."""
THEIR_K = -0.05
"""Of the authors' correction by hand, with which their camera points are given."""


@dataclass(frozen=True)
class Judged:
    """How far the fiducial points of the photograph lie from where a model says, in pixels of the photograph."""

    median: float
    rms: float


def photograph(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the photograph (2048, 2048) and what the mirrors showed (684, 608), 0 to 1."""
    image = np.asarray(Image.open(folder / "camera-alphabet-image-with-1.0x-tube.png").convert("L"), np.float64)
    shown = np.asarray(Image.open(folder / "dmd-alphabet-image.png").convert("L"), np.float32) / 255
    return image, shown


def as_captures(image: np.ndarray, shown: np.ndarray, factor: int) -> Captures:
    """Return one capture of an even target, of means over factor x factor pixels, with 12 bits."""
    height, width = (side // factor for side in image.shape)
    binned = image.reshape(height, factor, width, factor).mean((1, 3))
    return Captures(
        patterns=shown[None],
        sequence=np.zeros((1, 2), np.int64),
        measurement=np.rint(binned * (4095 / 255)).astype(np.uint16)[None],
        scene=np.ones((1, 2, height, width), np.float32),
        aperture=np.full(1, 0.5, np.float32),
        exposure=np.ones(1, np.float32),
        kind=("static",),
        bit_depth=12,
        name="dmd_alphabet",
    )


def fiducial_points(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return (column, row) on the device and (x, y) in the photograph as it is, both (28, 2) and from 0."""
    points = loadmat(folder / "fiducial-points-for-1.0x-tube.mat")
    corrected = points["camera_points"] - 1024.0
    radius = np.hypot(*corrected.T)[:, None] / 1448.2
    photographed = corrected * (1 + THEIR_K * radius**2) / (1 + THEIR_K / 2)
    return points["dmd_points"] - 1.0, photographed + 1024.0 - 1.0


def judged(path: LightPath, folder: Path, factor: int) -> Judged:
    """Judge a camera of binned pixels by the fiducial points."""
    grid = path.grid
    assert grid is not None
    on_device, photographed = fiducial_points(folder)
    height, width = grid.field

    def seen_at(place: np.ndarray) -> np.ndarray:
        """The mirror (column, row) seen at a place of the photograph."""
        x, y = ((p + 0.5) / factor - side / 2 for p, side in zip(place, (width, height), strict=True))
        y_, x_ = path.pose.nominal_at(torch.tensor([[y]]).double(), torch.tensor([[x]]).double(), grid.field)
        row, column = grid.mirror_at(y_, x_)
        return np.array([float(column), float(row)])

    errors = []
    for mirror, point in zip(on_device, photographed, strict=True):
        result = fsolve(lambda place, mirror=mirror: seen_at(place) - mirror, point)
        errors.append(float(np.hypot(*(result - point))))
    return Judged(float(np.median(errors)), float(np.sqrt(np.mean(np.square(errors)))))


def registered(folder: Path) -> tuple[Registration, LightPath]:
    """Register means over ``REGISTERED`` x ``REGISTERED`` pixels of the photograph, without a hint."""
    captures = as_captures(*photograph(folder), REGISTERED)
    registration = register(captures)
    grid = ModulatorGrid(registration.matrix, captures.size, captures.mirrors)
    return registration, LightPath([MaskDistortion(k=registration.distortion)], grid)


EXPECTED = (
    {"mask_contrast": {"leak": 0.3}, "gain": {"factor": 1.0}, "mask_blur": {"sigma": 1.5}},
    {"illumination": {"std": 0.1}},
    {
        "mask_keystone": {"tilt_x": 0.0, "tilt_y": 0.0},
        "mask_shift": {"dx": 0.0, "dy": 0.0},
        "mask_scale": {"scale": 1.0},
        "mask_rotation": {"angle": 0.0},
    },
)
"""What is expected by hand (haze, defocus, uneven light, keystone, barrel distortion), and where its fit starts."""


def fitted(folder: Path, registration: Registration) -> tuple[Hypothesis, LightPath]:
    """Fit the expected effects, one group after the other, from a registration on, without a search."""
    nominal = of_binned_field(registration.matrix, FITTED // REGISTERED)
    captures = replace(as_captures(*photograph(folder), FITTED), sensor_to_modulator=nominal)
    observation = observe(captures)
    model = CameraModel(observation, vocabulary())
    hypothesis, _ = datasheet_noise(observation)
    hypothesis = hypothesis.with_effect("mask_distortion", {"k": registration.distortion})
    fitter = Fitter(model, split(observation))
    for settings in EXPECTED:
        for name, setting in settings.items():
            hypothesis = hypothesis.with_effect(name, dict(setting), model.zero_map(name))
        fitter = fitter.covering(hypothesis)
        hypothesis = fitter.fit(hypothesis, iterations=25).hypothesis
    return hypothesis, model.path(hypothesis)
