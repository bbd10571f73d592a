"""The photograph of a micromirror device's letters, and the points by which a model of it is judged.

The fiducial points (clicked by hand on the letters) only judge: no registration and no fit sees them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from scipy.io import loadmat
from scipy.optimize import fsolve

from sci_lightning.captures import Captures
from sci_lightning.captures.registration import Registration, register
from sci_lightning.encoder.effects import MaskDistortion
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.modulator_grid import ModulatorGrid

REGISTERED = 4
"""Pixels of the photograph along the side of a pixel that is registered."""
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
        y_, x_ = path.geometry.nominal_at(torch.tensor([[y]]).double(), torch.tensor([[x]]).double(), grid.field)
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
