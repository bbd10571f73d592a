"""Light from the modulator to the sensor: mirrors, relay, exposure and lens, on samples finer than the pixels.

Geometrical imaging of an incoherent source: irradiances add (Goodman, Introduction to Fourier Optics, chapter 6). Here
is everything up to the mean light of a pixel; the charge that it sets free is in ``sensor.py``.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_array

from tests.textbook_camera.camera import (
    MARGIN,
    MIRROR_MARGIN,
    MIRROR_UM,
    PIXEL_UM,
    RELAY_MAGNIFICATION,
    RESET_BLOCKS,
    SAMPLES,
    SLOTS,
    STEPS,
    Camera,
    Colour,
)
from tests.textbook_camera.targets import smooth_field

Segment = tuple[float, float, np.ndarray]
"""Begin and end in slots, and the state of the mirrors ``(M, M)`` in [0, 1] between them."""


def sample_places(size: int) -> np.ndarray:
    """Return the distances of the samples from the axis along one side, in micrometres."""
    samples = (size + 2 * MARGIN) * SAMPLES
    return (np.arange(samples) - (samples - 1) / 2.0) * PIXEL_UM / SAMPLES


def mirror_places(camera: Camera, colour: Colour, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which mirror each sample sees, as fractional column and row of the array, two arrays ``(n, n)``.

    This is the relay, backwards: decentring, radial distortion (Hecht, Optics, chapter 6), keystone of a tilted plane
    (a homography; Hartley and Zisserman, Multiple View Geometry, chapter 2), roll and magnification about the axis.
    """
    places = sample_places(size)
    half, corner = size / 2.0 * PIXEL_UM, size / np.sqrt(2.0) * PIXEL_UM
    x = places[None] - camera.decentre_um[0] - colour.dispersion_um + 0.0 * places[:, None]
    y = places[:, None] - camera.decentre_um[1] + 0.0 * places[None]
    distorted = np.hypot(x, y) / corner
    radius = distorted.copy()
    for _ in range(8):  # Newton's method for radius (1 + radial radius^2) = distorted
        radius -= (radius * (1.0 + camera.radial * radius**2) - distorted) / (1.0 + 3.0 * camera.radial * radius**2)
    shrink = 1.0 / (1.0 + camera.radial * radius**2)
    x, y = x * shrink, y * shrink
    nearer = 1.0 / (1.0 + (camera.tilt[0] * x + camera.tilt[1] * y) / half)
    x, y = x * nearer, y * nearer
    cosine, sine = np.cos(camera.roll_rad), np.sin(camera.roll_rad)
    x, y = cosine * x + sine * y, cosine * y - sine * x
    magnification = RELAY_MAGNIFICATION * (1.0 + camera.magnification_error) * (1.0 + colour.magnification_error)
    centre = (size + 2 * MIRROR_MARGIN - 1) / 2.0
    return x / magnification / MIRROR_UM + centre, y / magnification / MIRROR_UM + centre


def relay_matrix(camera: Camera, colour: Colour, size: int) -> csr_array:
    """Return the matrix (samples, mirrors) of the part of each sample's area that each mirror's image covers.

    A sample is a rectangle of the size that the local magnification gives it, a mirror a square with the root of the
    fill factor as its side; the roll within one sample is neglected. Without gaps the sum of a row is 1.
    """
    mirrors, side = size + 2 * MIRROR_MARGIN, np.sqrt(camera.fill_factor)
    covered = []
    for place, axis in zip(mirror_places(camera, colour, size), (1, 0), strict=True):
        half = np.gradient(place, axis=axis) / 2.0
        first = np.floor(place - half + 0.5).astype(int)
        along = []
        for mirror in (first, first + 1):
            ends = np.minimum(place + half, mirror + side / 2.0), np.maximum(place - half, mirror - side / 2.0)
            part = np.clip(ends[0] - ends[1], 0.0, None) / (2.0 * half)
            along.append((np.clip(mirror, 0, mirrors - 1), part * ((mirror >= 0) & (mirror < mirrors))))
        covered.append(along)
    entries = [(row * mirrors + column, wide * high) for column, wide in covered[0] for row, high in covered[1]]
    places = np.tile(np.arange(entries[0][0].size), 4)
    columns = np.concatenate([index.ravel() for index, _ in entries])
    values = np.concatenate([part.ravel() for _, part in entries])
    return csr_array((values, (places, columns)), shape=(entries[0][0].size, mirrors * mirrors))


def display(camera: Camera, patterns: np.ndarray, sequence: tuple[int, ...]) -> list[Segment]:
    """Return what the mirrors show during one exposure, one after the other, from ``patterns`` (P, M, M) in [0, 1]."""
    order = [int(pattern) for pattern in np.roll(sequence, camera.slots_late)]
    if camera.swapped is not None:
        exchange = dict(zip(camera.swapped, camera.swapped[::-1], strict=True))
        order = [exchange.get(pattern, pattern) for pattern in order]
    commanded, dark, wait = patterns[order], camera.off_light, (1.0 - camera.duty) / 2.0
    segments: list[Segment] = []
    if camera.planes:  # binary pulse-width modulation: a plane lasts as long as its bit is worth
        levels = np.rint(commanded * 15.0).astype(int)
        for slot, level in enumerate(levels):
            begin = slot + wait
            for bit in camera.planes:
                end = begin + 2**bit / 15.0 * camera.duty
                segments.append((begin, end, dark + (1.0 - dark) * ((level >> bit) & 1)))
                begin = end
        return segments
    shown = dark + (1.0 - dark) * commanded**camera.level_exponent
    before = shown[-1]
    for slot, state in enumerate(shown):
        before = (1.0 - camera.retention) * state + camera.retention * before
        segments.append((slot + wait, slot + wait + camera.duty, before))
    return segments


def light_time(camera: Camera, segments: list[Segment], edges: np.ndarray) -> np.ndarray:
    """Return the light that each block of mirrors sends in each segment and time step, ``(blocks, segments, steps)``.

    The unit is the light of one slot of a steady source. ``edges`` (steps + 1) are times in slots. The display repeats
    itself; a source that flickers is integrated over the time of each segment.
    """
    delay = camera.late_slots + camera.reset_slots * np.arange(RESET_BLOCKS) / (RESET_BLOCKS - 1)
    begin, end = np.array([[segment[0], segment[1]] for segment in segments]).T
    cycle = np.arange(-1, 2)[:, None, None, None] * SLOTS + delay[:, None, None]
    low = np.maximum(begin[:, None] + cycle, edges[:-1])
    high = np.maximum(np.minimum(end[:, None] + cycle, edges[1:]), low)
    pulse = 2.0 * np.pi * camera.flicker_cycles / SLOTS
    swing = np.cos(pulse * low + camera.flicker_phase_rad) - np.cos(pulse * high + camera.flicker_phase_rad)
    return (high - low + camera.flicker_depth / pulse * swing).sum(0)


class Bench:
    """The optical bench: a camera, its field of ``size`` pixels, and patterns (P, M, M) on all mirrors."""

    def __init__(self, camera: Camera, patterns: np.ndarray, size: int, rng: np.random.Generator) -> None:
        self.camera, self.size = camera, size
        turned = {
            "": patterns,
            "flip_lr": patterns[:, :, ::-1],
            "flip_ud": patterns[:, ::-1],
            "rot180": patterns[:, ::-1, ::-1],
            "transpose": patterns.swapaxes(1, 2),
        }
        alive = rng.random(patterns.shape[1:]) >= camera.stuck
        self.patterns = turned[camera.orientation] * alive
        self.relays = [(colour.share, relay_matrix(camera, colour, size)) for colour in camera.colours]
        places = sample_places(size)
        self.x = places[None] / (size / 2.0 * PIXEL_UM)
        self.radius2 = (self.x**2 + self.x.T**2) / 2.0
        uneven = smooth_field(rng, len(places), len(places) / 4.0)
        inside = uneven[MARGIN * SAMPLES : -MARGIN * SAMPLES, MARGIN * SAMPLES : -MARGIN * SAMPLES]
        self.source = 1.0 + camera.uneven * (uneven - inside.mean()) / inside.std()
        slots = SLOTS + int(np.ceil(camera.shutter_slots))
        self.steps = slots * STEPS
        self._images: dict[tuple[tuple[int, ...], bool], np.ndarray] = {}

    def mask(self, sequence: tuple[int, ...], moving: bool) -> np.ndarray:
        """Return the modulator's image in light per time step, ``(steps, n, n)``; one step for a target at rest."""
        key = (sequence, moving)
        if key not in self._images:
            rolling = self.camera.shutter_slots > 0.0
            edges = np.arange(self.steps + 1) / STEPS if moving or rolling else np.array([0.0, SLOTS])
            segments = display(self.camera, self.patterns, sequence)
            weights = light_time(self.camera, segments, edges)
            states = np.stack([segment[2] for segment in segments])
            row = np.arange(states.shape[1]) - MIRROR_MARGIN
            block = np.clip(row * RESET_BLOCKS // self.size, 0, RESET_BLOCKS - 1)
            drive = np.einsum("rsq,srm->qrm", weights[block], states).reshape(len(edges) - 1, -1)
            image = sum(share * (matrix @ drive.T).T for share, matrix in self.relays)
            image = image.reshape(len(drive), len(self.x[0]), -1)
            if self.camera.relay_sigma_um:
                sigma = self.camera.relay_sigma_um / PIXEL_UM * SAMPLES
                image = gaussian_filter(image, (0.0, sigma, sigma), mode="nearest")
            if rolling:
                image = image * self._row_open(edges)[:, :, None]
            self._images[key] = image if moving else image.sum(0, keepdims=True)
        return self._images[key]

    def _row_open(self, edges: np.ndarray) -> np.ndarray:
        """Return the part of each time step during which each row of samples is exposed, ``(steps, n)``."""
        pixel = np.clip(np.arange(len(self.x[0])) // SAMPLES - MARGIN, 0, self.size - 1)
        begin = self.camera.shutter_slots * pixel / (self.size - 1)
        open_time = np.minimum(edges[1:, None], begin + SLOTS) - np.maximum(edges[:-1, None], begin)
        return np.clip(open_time / np.diff(edges)[:, None], 0.0, 1.0)

    def expose(self, sequence: tuple[int, ...], target: np.ndarray) -> np.ndarray:
        """Return the light on the sensor ``(n, n)`` for a target ``(steps, n, n)`` of one or all time steps."""
        light = (self.mask(sequence, len(target) > 1) * target).sum(0) * self.source * self.camera.source
        return self.lens(light)

    def lens(self, light: np.ndarray) -> np.ndarray:
        """Return the image of the lens ``(n, n)``: blur, vignetting, a ghost of two reflections, veiling glare."""
        camera = self.camera
        image = self._blurred(light)
        if camera.cosine_law:  # cos^4 of the field angle, which is set by the loss in the corner (Hecht, chapter 5)
            image = image / (1.0 + ((1.0 - camera.vignetting) ** -0.5 - 1.0) * self.radius2) ** 2
        else:
            image = image * np.clip(1.0 - camera.vignetting * self.radius2, 0.0, 1.0)
        if camera.ghost:  # an out-of-focus copy, turned by half a turn about a point beside the axis
            turned = np.roll(image[::-1, ::-1], (3 * SAMPLES, -5 * SAMPLES), (0, 1))
            image = (image + camera.ghost * gaussian_filter(turned, 1.5 * SAMPLES)) / (1.0 + camera.ghost)
        return (1.0 - camera.glare) * image + camera.glare * image.mean()

    def _blurred(self, light: np.ndarray) -> np.ndarray:
        """Return the light ``(n, n)`` under the lens's point spread function, a Gaussian that may vary over the field.

        Between the widths of a ladder the result is interpolated linearly in the variance, to which the blur of a
        smooth image is proportional.
        """
        camera, scale = self.camera, SAMPLES / PIXEL_UM
        along_y, along_x = camera.lens_sigma_um
        if not (camera.corner_sigma_um or camera.edge_sigma_um):
            sigma = (along_y * scale, along_x * scale)
            return gaussian_filter(light, sigma, mode="nearest") if any(sigma) else light
        added = camera.corner_sigma_um * self.radius2 + camera.edge_sigma_um * self.x
        variance = np.clip(along_x + added, 0.0, None) ** 2
        ladder = np.linspace(variance.min(), variance.max(), 41)
        out = np.zeros_like(light)
        for rung in ladder:
            weight = np.clip(1.0 - np.abs(variance - rung) / (ladder[1] - ladder[0]), 0.0, None)
            out += weight * gaussian_filter(light, np.sqrt(rung) * scale, mode="nearest")
        return out
