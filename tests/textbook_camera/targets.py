"""Targets: printed sheets of gray patches, textures and photographs-like scenes, some of them on a moving stage.

A target is a reflectance on the samples of the continuous image and repeats beyond them, so that the world goes on
beyond the field. The file is given the nominal target; before the camera stands the printed one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from tests.textbook_camera.camera import MARGIN, PIXEL_UM, SAMPLES, SLOTS, STEPS, Camera

TILE = 6
"""Side of a printed patch of the textures, in pixels."""


@dataclass(frozen=True)
class Target:
    """Reflectance as stated and as printed, in [0, 1], ``(n, n)`` samples; motion in pixels and parts per slot."""

    nominal: np.ndarray
    printed: np.ndarray
    velocity: tuple[float, float] = (0.0, 0.0)
    growth: float = 0.0
    misplaced_um: tuple[float, float] = (0.0, 0.0)

    @property
    def moves(self) -> bool:
        """Whether the target is on the moving stage."""
        return self.velocity != (0.0, 0.0)


def smooth_field(rng: np.random.Generator, samples: int, period: float) -> np.ndarray:
    """Return a random field ``(samples, samples)`` of mean 0 and standard deviation 1 without detail below a period.

    ``period`` is in samples. The field repeats beyond its edges.
    """
    frequency = np.hypot(np.fft.fftfreq(samples)[:, None], np.fft.rfftfreq(samples)[None])
    spectrum = np.fft.rfft2(rng.standard_normal((samples, samples)))
    spectrum *= np.exp(-0.5 * (2.0 * frequency * period) ** 2)
    spectrum[0, 0] = 0.0
    out = np.fft.irfft2(spectrum, (samples, samples))
    return out / out.std()


def _texture(rng: np.random.Generator, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a texture in [0.03, 1] and the number of the printed patch at each sample, both ``(samples, samples)``.

    Natural images have amplitudes that fall as one over the frequency (Goodman, Statistical Optics, on random fields,
    gives the construction): octaves of smooth fields, patches of constant gray and sharp edges between them.
    """
    place = np.arange(samples) // (TILE * SAMPLES)
    patch = place[:, None] * (place[-1] + 1) + place[None]
    octaves = sum(period * smooth_field(rng, samples, SAMPLES * period) for period in (2.0, 4.0, 8.0, 16.0)) / 30.0
    tiles = rng.uniform(-0.35, 0.35, patch.max() + 1)[patch]
    lit = (smooth_field(rng, samples, SAMPLES * 10.0) > 0.0) * rng.uniform(0.2, 0.5)
    image = 0.35 + 0.16 * octaves + rng.uniform(0.3, 1.0) * tiles + lit
    # Ink spreads by a sixth of a pixel, so that linear interpolation between the samples does not matter.
    return gaussian_filter(np.clip(image, 0.03, 1.0), SAMPLES / 6.0, mode="wrap"), patch


def make(name: str, camera: Camera, size: int, rng: np.random.Generator, laboratory: np.random.Generator) -> Target:
    """Return the target of a name such as ``gray 0.6``, ``texture 1`` or ``moving 3``; ``size`` in pixels.

    ``rng`` draws the target, ``laboratory`` the errors of its print and its place.
    """
    samples = (size + 2 * MARGIN) * SAMPLES
    kind, _, which = name.partition(" ")
    velocity, growth = (0.0, 0.0), 0.0
    if kind in ("black", "gray"):
        nominal, patch = np.full((samples, samples), float(which or 0.0)), np.zeros((samples, samples), int)
    else:
        nominal, patch = _texture(rng, samples)
    if kind == "moving":
        speed, heading = rng.uniform(0.3, 2.5), rng.uniform(0.0, 2.0 * np.pi)
        velocity, growth = (speed * np.cos(heading), speed * np.sin(heading)), rng.uniform(-0.01, 0.01)
    smooth = smooth_field(laboratory, samples, samples / 6.0)
    per_patch = laboratory.standard_normal(patch.max() + 1)[patch]
    place = camera.misplacement_um * laboratory.standard_normal(2)
    ink = (1.0 + camera.print_error * smooth) * (1.0 + camera.print_error * per_patch)
    printed = nominal**camera.target_exponent * ink
    if camera.target_sigma_um:
        printed = gaussian_filter(printed, camera.target_sigma_um / PIXEL_UM * SAMPLES, mode="wrap")
    return Target(nominal, printed, velocity, growth, (float(place[0]), float(place[1])))


Pose = tuple[tuple[float, float], float, float]
"""Shift in pixels along x and along y, scale, and roll in radians of a target that is not where the file says."""
AT_HOME: Pose = ((0.0, 0.0), 1.0, 0.0)


def _seen(sheet: np.ndarray, target: Target, slot: float, pose: Pose) -> np.ndarray:
    """Return the sheet ``(n, n)`` as it lies at a time in slots, after its motion and in its pose."""
    if not target.moves and pose == AT_HOME:
        return sheet
    shift_px, scale, roll = pose
    x = (np.arange(len(sheet)) - (len(sheet) - 1) / 2.0) / SAMPLES
    across, down = x[None] - shift_px[0], x[:, None] - shift_px[1]
    across, down = np.cos(roll) * across + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * across
    grown = 1.0 + target.growth * slot
    columns = (across / scale - target.velocity[0] * slot) / grown
    rows = (down / scale - target.velocity[1] * slot) / grown
    centre = (len(sheet) - 1) / 2.0
    return map_coordinates(sheet, [rows * SAMPLES + centre, columns * SAMPLES + centre], order=1, mode="grid-wrap")


def views(target: Target, camera: Camera, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the target as stated and as it stands before the camera at each time step, two arrays ``(steps, n, n)``.

    A target at rest has one step. The stage stops after ``SLOTS`` slots; a display holds its last frame then.
    """
    times = np.minimum((np.arange(steps if target.moves else 1) + 0.5) / STEPS, SLOTS)
    if not camera.stage:
        times = np.minimum(np.floor(times), SLOTS - 1) + 0.5
    place, lies = target.misplaced_um, camera.target_shift_um
    shift = ((place[0] + lies[0]) / PIXEL_UM, (place[1] + lies[1]) / PIXEL_UM)
    pose = (shift, 1.0 + camera.target_magnification_error, camera.target_roll_rad)
    moments, step = np.unique(times, return_inverse=True)
    nominal = np.stack([_seen(target.nominal, target, time, AT_HOME) for time in moments])[step]
    if pose == AT_HOME and np.array_equal(target.printed, target.nominal):
        return nominal, nominal
    return nominal, np.stack([_seen(target.printed, target, time, pose) for time in moments])[step]
