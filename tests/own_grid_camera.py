"""A brute-force camera whose modulator has a grid of its own; it shares no code with the package.

Every pixel is a bundle of rays through a regular lattice of points. A ray is traced back to the point of the modulator
that it sees, where it takes the transmittance of the one or two mirrors that it hits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from sci_lightning.captures import Captures

RAYS = 30
FULL_WELL, READ_NOISE = 10000.0, 0.8


@dataclass(frozen=True)
class Deviation:
    """How the mask's image deviates from where the homography says; in pixels and about the field's centre."""

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    scale: float = 1.0
    barrel: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0


def homography(
    pitch: tuple[float, float],
    angle: float = 0.0,
    size: tuple[int, int] = (48, 48),
    mirrors: tuple[int, int] = (64, 64),
    tilt: tuple[float, float] = (0.0, 0.0),
    mirrored: bool = False,
    offset: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """From pixels to mirrors: of so many pixels each (across, down), turned by degrees; the centres coincide."""
    turn = np.deg2rad(angle)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    linear = np.diag([(-1 if mirrored else 1) / pitch[0], 1 / pitch[1]]) @ turned
    to_centre = np.array([[1, 0, -(size[1] - 1) / 2], [0, 1, -(size[0] - 1) / 2], [0, 0, 1.0]])
    middle = np.array([[1, 0, (mirrors[1] - 1) / 2 + offset[0]], [0, 1, (mirrors[0] - 1) / 2 + offset[1]], [0, 0, 1.0]])
    inner = np.eye(3)
    inner[:2, :2] = linear
    inner[2, :2] = np.array(tilt) / (np.array(size[::-1]) / 2)
    whole = middle @ inner @ to_centre
    return np.asarray(whole / whole[2, 2])


def image(
    patterns: np.ndarray,
    matrix: np.ndarray,
    size: tuple[int, int],
    deviation: Deviation = Deviation(),
    beyond: float = 0.0,
    rays: int = RAYS,
) -> np.ndarray:
    """What the pixels see of patterns (P, Hm, Wm), (P, H, W), by so many rays along either axis of a pixel."""
    lattice = (np.arange(rays) + 0.5) / rays - 0.5
    y = (np.arange(size[0])[:, None] + lattice).ravel() - (size[0] - 1) / 2
    x = (np.arange(size[1])[:, None] + lattice).ravel() - (size[1] - 1) / 2
    y, x = np.meshgrid(y, x, indexing="ij")
    corner = (size[0] ** 2 + size[1] ** 2) / 4
    u, v = x, y
    for _ in range(30 if deviation.barrel else 0):
        stretch = 1 + deviation.barrel * (u * u + v * v) / corner
        u, v = x / stretch, y / stretch
    nearer = 1 + deviation.tilt[0] * u / (size[1] / 2) + deviation.tilt[1] * v / (size[0] / 2)
    u, v = u / nearer - deviation.shift[0], v / nearer - deviation.shift[1]
    turn = np.deg2rad(deviation.angle)
    u, v = (
        (np.cos(turn) * u + np.sin(turn) * v) / deviation.scale + (size[1] - 1) / 2,
        (np.cos(turn) * v - np.sin(turn) * u) / deviation.scale + (size[0] - 1) / 2,
    )
    place = np.einsum("ij,jhw->ihw", matrix, np.stack([u, v, np.ones_like(u)]))
    around = np.pad(patterns, ((0, 0), (1, 1), (1, 1)), constant_values=beyond)
    seen = np.zeros((len(patterns), *u.shape))
    for row, down in _mirrors(place[1] / place[2]):
        for column, across in _mirrors(place[0] / place[2]):
            rows, columns = (row + 1).clip(0, around.shape[1] - 1), (column + 1).clip(0, around.shape[2] - 1)
            seen += around[:, rows, columns] * (down * across)
    if deviation.blur:
        seen = np.stack([gaussian_filter(one, deviation.blur * rays, truncate=5) for one in seen])
    return np.asarray(seen.reshape(-1, size[0], rays, size[1], rays).mean((2, 4)))


@lru_cache(maxsize=16)
def _images(
    patterns: bytes, shape: tuple[int, ...], matrix: tuple[float, ...], size: tuple[int, int], deviation: Deviation
) -> np.ndarray:
    """Return :func:`image` with the surround of :func:`captures`: many tests take captures of the same camera."""
    return image(np.frombuffer(patterns).reshape(shape), np.reshape(matrix, (3, 3)), size, deviation, beyond=0.35)


def _mirrors(place: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the one or two mirrors that a ray of some width sees along an axis, and the parts of it."""
    width = np.abs(np.gradient(place, axis=0)) + np.abs(np.gradient(place, axis=1))
    low, high = place - width / 2 + 0.5, place + width / 2 + 0.5
    last = np.floor(high)
    part = np.where(last > np.floor(low), (high - last) / width, 0.0)
    return [(np.floor(low).astype(int), 1 - part), (last.astype(int), part)]


def captures(
    matrix: np.ndarray,
    deviation: Deviation = Deviation(),
    size: tuple[int, int] = (48, 48),
    mirrors: tuple[int, int] = (64, 64),
    frames: int = 4,
    seed: int = 0,
    known: bool = True,
    nominal: np.ndarray | None = None,
    **changes: Any,
) -> Captures:
    """Captures of the usual kinds, with shot and read noise, 8 bits; ``nominal``, else ``matrix`` is in the file."""
    random = np.random.default_rng(seed)
    coding = random.integers(0, 2, (frames, *mirrors)).astype(np.float64)
    patterns = np.concatenate((coding, np.zeros((1, *mirrors)), np.ones((1, *mirrors))))
    images = _images(patterns.tobytes(), patterns.shape, tuple(matrix.ravel().tolist()), size, deviation)
    off, on, slots = np.full(frames, frames), np.full(frames, frames + 1), np.arange(frames)
    plan: list[tuple[np.ndarray, Any, float]] = [(off, 0.0, 1.0)] * 3
    plan += [(slots, level, 2 / frames) for level in (0.3, 0.6, 0.9)]
    plan += [(on, 0.9, 1 / frames), (off, 0.9, 1.0)]
    plan += [(np.where(slots == slot, slot, off), 0.9, 1.0) for slot in range(frames)]
    for _ in range(6):
        texture = gaussian_filter(random.random((frames, *size)), (1.0, 1.5, 1.5))
        low, high = np.percentile(texture, (1, 99))
        plan.append((slots, np.clip((texture - low) / (high - low), 0, 0.95), 2 / frames))
    dn, scenes = [], []
    for sequence, level, aperture in plan:
        scene = np.broadcast_to(np.asarray(level, float), (frames, *size))
        light = aperture * (images[sequence] * scene).sum(0)
        signal = random.poisson(np.maximum(light, 0) * FULL_WELL) / FULL_WELL + random.normal(0, READ_NOISE / 255, size)
        dn.append(np.floor(signal.clip(0, 1) * 255 + 0.5).astype(np.uint8))
        scenes.append(scene.astype(np.float32))
    content: dict[str, Any] = {
        "patterns": patterns.astype(np.float32),
        "sequence": np.array([sequence for sequence, _, _ in plan]),
        "measurement": np.stack(dn),
        "scene": np.stack(scenes) if known else np.full((len(plan), frames, *size), np.nan, np.float32),
        "aperture": np.array([aperture for *_, aperture in plan], np.float32),
        "exposure": np.ones(len(plan), np.float32),
        "kind": tuple("unknown" for _ in plan),
        "bit_depth": 8,
        "read_noise_dn": READ_NOISE,
        "full_well_e": FULL_WELL,
        "sensor_to_modulator": matrix if nominal is None else nominal,
    }
    return Captures(**{**content, **changes})
