"""A second, brute-force camera whose world goes on beyond the field; it shares no code with the package.

Every mirror and every pixel is divided into ``FINE`` x ``FINE`` points. A point of a pixel is traced back to the
mirrors that it sees, light is added up point by point, and what lies beyond the field (``BEYOND`` mirrors on each side)
is as random as what lies inside.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from sci_lightning.captures import Captures

FINE = 10
BEYOND = 8
FULL_WELL, READ_NOISE = 10000.0, 0.8


@dataclass(frozen=True)
class Hidden:
    """What is wrong with the camera or with the target; the defaults are those of an ideal laboratory."""

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    scale: float = 1.0
    barrel: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    mask_blur: float = 0.0
    blur: float = 0.0
    leak: float = 0.0
    duty: float = 1.0
    glare: float = 0.0
    gain: float = 1.0
    black: float = 0.0
    light: float = 0.0
    vignetting: float = 0.0
    scene_shift: tuple[float, float] = (0.0, 0.0)
    scene_angle: float = 0.0
    scene_scale: float = 1.0
    scene_blur: float = 0.0
    scene_gamma: float = 1.0
    extra: dict[str, float] = field(default_factory=dict)


def captures(hidden: Hidden, size: int = 64, seed: int = 0, frames: int = 8, surround: str = "unknown") -> Captures:
    """Return 34 captures of the usual kinds, with shot noise and read noise, 8 bits."""
    random = np.random.default_rng(seed)
    world = size + 2 * BEYOND
    inner = slice(BEYOND, BEYOND + size)
    levels = random.dirichlet(np.ones(frames), (world, world)).transpose(2, 0, 1)
    coding = np.round(levels * 16) / 16
    patterns = np.concatenate((coding, np.zeros((1, world, world)), np.ones((1, world, world)))).clip(0, 1)
    off, on, all_slots = np.full(frames, frames), np.full(frames, frames + 1), np.arange(frames)
    plan: list[tuple[str, np.ndarray, np.ndarray | float, float]] = [("dark", off, 0.0, 1.0)] * 4
    plan += [("flat", all_slots, float(level), 1.0) for level in np.linspace(0.1, 0.95, 6)]
    plan += [("flat", on, level, 1 / frames) for level in (0.1, 0.95)]
    plan += [("pattern", off, level, 1.0) for level in (0.1, 0.95)]
    plan += [("pattern", np.where(all_slots == slot, slot, off), 0.9, 1.0) for slot in range(frames)]
    plan += [("static", all_slots, _texture(random, world, frames, 0.0), 1.0) for _ in range(6)]
    plan += [("dynamic", all_slots, _texture(random, world, frames, random.uniform(0.5, 2.5)), 1.0) for _ in range(6)]
    images = _images(patterns, hidden)
    dn, scenes = [], []
    for _, sequence, told, aperture in plan:
        scene = np.broadcast_to(np.asarray(told, float), (frames, world, world))
        shown = hidden.duty * images[sequence]
        light = aperture * (shown * _fine(_displayed(scene, hidden))).sum(0)
        light = _imaged(light, hidden)[inner, inner]
        light = _shaded(light, hidden)
        electrons = random.poisson(light * hidden.gain * FULL_WELL) / FULL_WELL
        signal = electrons + hidden.black + random.normal(0, READ_NOISE / 255, light.shape)
        dn.append(np.floor(signal.clip(0, 1) * 255 + 0.5).astype(np.uint8))
        scenes.append(scene[:, inner, inner].astype(np.float32))
    return Captures(
        patterns=patterns[:, inner, inner].astype(np.float32),
        sequence=np.array([sequence for _, sequence, _, _ in plan]),
        measurement=np.stack(dn),
        scene=np.stack(scenes),
        aperture=np.array([aperture for *_, aperture in plan], np.float32),
        exposure=np.ones(len(plan), np.float32),
        kind=tuple(kind for kind, *_ in plan),
        bit_depth=8,
        read_noise_dn=READ_NOISE,
        full_well_e=FULL_WELL,
        surround=surround,
    )


def _texture(random: np.random.Generator, world: int, frames: int, speed: float) -> np.ndarray:
    """Return blurred noise in motion, (T, world, world) in [0, 1]."""
    large = gaussian_filter(random.random((world + 64, world + 64)), random.uniform(1.0, 2.5))
    low, high = np.percentile(large, (1, 99))
    direction = random.uniform(0, 2 * np.pi)
    y, x = np.indices((world, world)) + 32.0
    frames_at = [
        map_coordinates(large, [y + speed * t * np.sin(direction), x + speed * t * np.cos(direction)], order=1)
        for t in range(frames)
    ]
    return np.clip((np.array(frames_at) - low) / (high - low), 0, 1) * 0.95


def _points(world: int) -> tuple[np.ndarray, np.ndarray]:
    """Return y (n, 1) and x (1, n) of all points, in pixels from the centre."""
    place = (np.arange(world * FINE) + 0.5) / FINE - world / 2
    return place[:, None], place[None]


def _fine(field_: np.ndarray) -> np.ndarray:
    """Return a field of pixels on all points."""
    return field_.repeat(FINE, -1).repeat(FINE, -2)


def _images(patterns: np.ndarray, hidden: Hidden) -> np.ndarray:
    """Return what every point receives through each pattern, (P, n, n)."""
    world = patterns.shape[-1]
    field_size = world - 2 * BEYOND
    shown = (hidden.leak + (1 - hidden.leak) * patterns).astype(np.float32)
    y, x = _points(world)
    y, x = np.broadcast_arrays(y, x)
    u, v = x, y
    half, corner = field_size / 2, 2 * (field_size / 2) ** 2
    for _ in range(30 if hidden.barrel else 0):  # what belongs at (u, v) is seen at (x, y)
        stretch = 1 + hidden.barrel * (u * u + v * v) / corner
        u, v = x / stretch, y / stretch
    nearer = 1 + hidden.tilt[0] * u / half + hidden.tilt[1] * v / half
    u, v = u / nearer - hidden.shift[0], v / nearer - hidden.shift[1]
    turn = np.deg2rad(hidden.angle)
    cos, sin = np.cos(turn) / hidden.scale, np.sin(turn) / hidden.scale
    images = np.zeros((len(shown), *u.shape), np.float32)
    for row, part_of_row in _seen(cos * v - sin * u + world / 2, world):
        for column, part_of_column in _seen(cos * u + sin * v + world / 2, world):
            images += shown[:, row, column] * (part_of_row * part_of_column)
    if hidden.mask_blur:
        images = np.stack([gaussian_filter(image, hidden.mask_blur * FINE) for image in images])
    return images


def _seen(place: np.ndarray, world: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the one or two mirrors that a point of width 1 / FINE sees along one axis, and the parts of it."""
    first, last = np.floor(place - 0.5 / FINE), np.floor(place + 0.5 / FINE)
    part = np.where(last > first, (place + 0.5 / FINE - last) * FINE, 0.0).astype(np.float32)
    return [(index.astype(int).clip(0, world - 1), share) for index, share in ((first, 1 - part), (last, part))]


def _displayed(scene: np.ndarray, hidden: Hidden) -> np.ndarray:
    """Return the scene as the target really is."""
    scene = scene**hidden.scene_gamma
    if hidden.scene_blur:
        scene = np.stack([gaussian_filter(frame, hidden.scene_blur, truncate=5) for frame in scene])
    if hidden.scene_shift != (0.0, 0.0) or hidden.scene_angle or hidden.scene_scale != 1:
        world = scene.shape[-1]
        y, x = np.indices((world, world)) - (world - 1) / 2
        y, x = y - hidden.scene_shift[1], x - hidden.scene_shift[0]
        turn = np.deg2rad(hidden.scene_angle)
        cos, sin = np.cos(turn) / hidden.scene_scale, np.sin(turn) / hidden.scene_scale
        place = [cos * y - sin * x + (world - 1) / 2, cos * x + sin * y + (world - 1) / 2]
        scene = np.stack([map_coordinates(frame, place, order=3, mode="nearest") for frame in scene]).clip(0)
    return scene


def _imaged(light: np.ndarray, hidden: Hidden) -> np.ndarray:
    """Return the pixels' light (world, world) of the light at every point."""
    world = light.shape[-1] // FINE
    if hidden.blur:
        # Light counts as being in the middle of its point, both before and after: the kernel makes up for these widths.
        light = gaussian_filter(light, np.hypot(hidden.blur * FINE, (1 / 6) ** 0.5), truncate=5)
    if hidden.extra.get("ghost"):
        across, down = round(hidden.extra["dx"] * FINE), round(hidden.extra["dy"] * FINE)
        part = hidden.extra["ghost"]
        light = (1 - part) * light + part * np.roll(light, (down, across), (0, 1))
    return light.reshape(world, FINE, world, FINE).mean((1, 3))


def _shaded(light: np.ndarray, hidden: Hidden) -> np.ndarray:
    size = light.shape[-1]
    y, x = (np.indices((size, size)) - (size - 1) / 2) / ((size - 1) / 2)
    light = light * (1 - hidden.vignetting * (x * x + y * y) / 2)
    light = light * (1 + hidden.light * np.sin(2.1 * x + 0.4) * np.cos(1.7 * y - 0.3))
    return light * (1 - hidden.glare) + hidden.glare * light.mean()
