"""Light that is sampled: rays through the relay and the optics, and the exposure as a row of instants.

Rays run from mirrors forwards through the relay, and from pixels backwards through blurred optics. The other
formulation multiplies the mean light of a slot by what is displayed in the slot on average. Here a pattern that comes
late meets the light of the moments at which it is displayed.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csr_matrix
from scipy.special import ndtri

from sci_lightning.virtual_camera.hardware.exposure import Part, Timing
from sci_lightning.virtual_camera.hardware.optics import Image
from sci_lightning.virtual_camera.hardware.relay import Relay

RAYS = 2_000_000
"""Rays that are traced at a time; they take about 100 MB."""
BUNDLES = 64
"""Different bundles of rays; every pixel takes one of them at random."""


def through_the_relay(
    relay: Relay,
    mirrors: tuple[int, int],
    field: tuple[int, int],
    fill_factor: float,
    strata: int,
    cells: int,
    random: np.random.Generator,
) -> csr_matrix:
    """Return which mirrors light which cells of the image plane, sharply.

    A mirror is a square that reflects in the middle of its cell of 1 pixel. Its ``strata`` x ``strata`` rays start at a
    random place each of their own part of it, carry the same light (a mirror that is on lights its image with 1 on
    average, at any magnification), and light the cell in which they land. The relay is run through forwards: magnified,
    turned, displaced, in perspective, and pushed outwards or inwards by the lens.

    Args:
        relay: displacement, rotation, magnification and distortion; its blur comes later, see :func:`gathered`.
        mirrors: rows and columns of mirrors, those beyond the field included.
        field: (H, W) of the field in pixels, from which perspective and distortion are measured.
        fill_factor: part of a mirror's cell that reflects.
        strata: see above.
        cells: cells per pixel and axis.
        random: source of the random places.

    Returns:
        (cells, mirrors), each in rows, over the area that the mirrors cover.
    """
    height, width = mirrors
    side, middle = math.sqrt(fill_factor), (height / 2, width / 2)
    strips = math.ceil(height / max(RAYS // (width * strata**2), 1))
    parts = []
    for rows in np.array_split(np.arange(height), strips):
        grid = (len(rows), width, strata, strata)
        down = (np.arange(strata)[:, None] + random.random(grid)) / strata
        across = (np.arange(strata) + random.random(grid)) / strata
        y = rows[:, None, None, None] + 0.5 + side * (down - 0.5) - middle[0]
        x = np.arange(width)[:, None, None] + 0.5 + side * (across - 0.5) - middle[1]
        y, x, light = landing(relay, y, x, field)
        row, column = (np.floor((at + half) * cells).astype(np.int64) for at, half in ((y, middle[0]), (x, middle[1])))
        light = np.broadcast_to(light * (cells / strata) ** 2, grid)
        parts.append(_pairs(row, column, light, rows[0] * width, (height * cells, width * cells)))
    light, cell, mirror = (np.concatenate(values) for values in zip(*parts, strict=True))
    return csr_matrix((light, (cell, mirror)), (height * width * cells**2, height * width))


def landing(
    relay: Relay, y: np.ndarray, x: np.ndarray, field: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where rays from (y, x) on the mirrors land, from the middle of the field, and the light that each carries.

    The light of a ray is how much its surroundings are magnified, so that the irradiance stays that of the mirror.
    """
    cos, sin = relay.scale * math.cos(relay.angle), relay.scale * math.sin(relay.angle)
    y, x = cos * y + sin * x + relay.dy, cos * x - sin * y + relay.dx
    light = np.full((1,) * y.ndim, relay.scale**2)
    height, width = field
    if relay.tilt_x or relay.tilt_y:
        nearer = 1 / (1 - 2 * (relay.tilt_x * x / width + relay.tilt_y * y / height))
        y, x, light = y * nearer, x * nearer, light * nearer**3
    if relay.k:
        bend = relay.k * (y**2 + x**2) / (height**2 + width**2) * 4
        y, x, light = y * (1 + bend), x * (1 + bend), light * (1 + bend) * (1 + 3 * bend)
    return y, x, light


def _pairs(
    row: np.ndarray, column: np.ndarray, light: np.ndarray, first_mirror: int, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the light, the cell and the mirror of every pair of which one lights the other.

    Args:
        row, column: (rows, columns, strata, strata) cell in which every ray lands.
        light: of every ray, of the same shape.
        first_mirror: number of the first of these mirrors.
        shape: rows and columns of cells; rays that land beyond are lost.
    """
    first_row, first_column = (cell.min((2, 3), keepdims=True) for cell in (row, column))
    down, across = int((row - first_row).max()) + 1, int((column - first_column).max()) + 1
    around = (row - first_row) * across + column - first_column  # one of the few cells around the place of a mirror
    mirrors = around.shape[0] * around.shape[1]
    number = np.arange(mirrors).reshape(*around.shape[:2], 1, 1) * (down * across) + around
    counted = np.bincount(number.ravel(), light.ravel(), mirrors * down * across)
    mirror, place = np.divmod(np.arange(len(counted)), down * across)
    row = first_row.ravel()[mirror] + place // across
    column = first_column.ravel()[mirror] + place % across
    seen = (counted > 0) & (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    return counted[seen], (row * shape[1] + column)[seen], first_mirror + mirror[seen]


def gathered(
    image: Image, shape: tuple[int, int], cells: int, targets: int, strata: int, random: np.random.Generator, dark: bool
) -> csr_matrix:
    """Return from which cells the light of every target comes that one image of a lens brings.

    A target (a pixel, or a cell itself) sends rays backwards from random places of its area, which a Gaussian deflects.
    There are ``BUNDLES`` bundles of them, and every target takes one at random.

    Args:
        image: displacement and blur; its share of the light is applied as well.
        shape: (rows, columns) of the cells.
        cells: cells per pixel and axis.
        targets: cells per target and axis: ``cells`` for pixels, 1 for cells.
        strata: a bundle has ``strata`` x ``strata`` rays.
        random: source of the random places.
        dark: whether no light comes from beyond the cells; otherwise the outermost ones go on there.

    Returns:
        (targets, cells), each in rows.
    """
    height, width = shape[0] // targets, shape[1] // targets
    chosen = random.integers(BUNDLES, size=(height, width))
    parts = []
    for number in range(BUNDLES):
        rows, columns = np.nonzero(chosen == number)
        offset_y = _offsets(image.dy, image.sigma, cells, targets, strata, random)
        offset_x = _offsets(image.dx, math.hypot(image.sigma, image.sigma_x), cells, targets, strata, random).T
        pairs = np.stack(np.broadcast_arrays(offset_y, offset_x), -1).reshape(-1, 2)
        offsets, count = np.unique(pairs, axis=0, return_counts=True)
        row = rows[:, None] * targets + offsets[:, 0]
        column = columns[:, None] * targets + offsets[:, 1]
        light = np.broadcast_to(image.share * count / strata**2, row.shape)
        if dark:
            light = light * ((row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1]))
        source = row.clip(0, shape[0] - 1) * shape[1] + column.clip(0, shape[1] - 1)
        target = np.broadcast_to((rows * width + columns)[:, None], row.shape)
        parts.append((light.ravel(), target.ravel(), source.ravel()))
    light, target, source = (np.concatenate(values) for values in zip(*parts, strict=True))
    return csr_matrix((light, (target, source)), (height * width, shape[0] * shape[1]))


def _offsets(
    shift: float, sigma: float, cells: int, targets: int, strata: int, random: np.random.Generator
) -> np.ndarray:
    """Return by how many cells the rays of a bundle end away from the target's first cell, along one axis.

    Returns:
        (strata, strata) whole numbers; along the first axis the rays' places and deflections are stratified.
    """
    places = (np.arange(strata)[:, None] + random.random((strata, strata))) / strata
    angles = (
        random.permuted(np.tile(np.arange(strata)[:, None], strata), axis=0) + random.random((strata,) * 2)
    ) / strata
    away = targets / cells * places - shift + sigma * ndtri(angles)
    return np.floor(away * cells).astype(np.int64)


INSTANTS = 1000
"""Random instants in every slot, one in each thousandth of it."""


def slot_shares(
    timing: Timing, part: Part, displayed: np.ndarray, late: float, rows: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return how much light of every frame of the scene passes every commanded pattern, row by row.

    Args:
        timing: the lamp, the shutter and the part of a slot during which the mirrors are lit.
        part: of the patterns, and when it is displayed.
        displayed: (T, T) what the mirrors have made of the commanded patterns: the share of every one of them in what
            they display in turn.
        late: slots by which the mirrors switch late, cyclically; negative for early.
        rows: H, rows of the sensor.
        random: source of the instants.

    Returns:
        (H, T, T): row, commanded slot, frame of the scene; 1 where the slot of a pattern is that of the frame. And the
        same times how long after the middle of its slot the light passes, in slots: what meets the scene's change.
    """
    slots = len(displayed)
    last = slots + math.ceil(timing.delay)
    time = (np.arange(last * INSTANTS) + random.random(last * INSTANTS)) / INSTANTS
    slot = time.astype(int)
    into = time - slot
    lamp = 1 + timing.amplitude * np.sin(2 * np.pi * timing.frequency * time / slots + timing.phase)
    lit = (into < timing.duty) & ((slot % slots != timing.slot) | (into < 1 - timing.loss))
    lamp = np.maximum(lamp, 0) * lit * timing.slot_levels(slots)[slot % slots]
    opens = timing.delay * np.arange(rows) / max(rows - 1, 1)
    exposed = (time >= opens[:, None]) & (time < opens[:, None] + slots)
    since = time - late - part.start
    shows = displayed[np.floor(since).astype(int) % slots] * (since % 1 < part.stop - part.start)[:, None]
    frame = np.minimum(slot, slots - 1)
    after = np.where(slot < slots, into - 0.5, 0)
    shares, moments = np.zeros((2, rows, slots, slots))
    for number in range(slots):
        during = frame == number
        light = exposed[:, during] * lamp[during]
        shares[:, :, number] = light @ shows[during] / INSTANTS
        moments[:, :, number] = light * after[during] @ shows[during] / INSTANTS
    return shares, moments


def settled(order: int, lag: float, slots: int) -> np.ndarray:
    """Return the share (T, T) of every commanded pattern in what the mirrors display in turn.

    The mirrors are followed slot by slot: in each they forget all but ``lag`` of what they displayed before, beginning
    with the pattern of the last slot.

    Args:
        order: slots by which the sequence starts late.
        lag: part of the slot before that is still displayed.
        slots: T.
    """
    commanded = np.eye(slots)[(np.arange(slots) - order) % slots]
    now = commanded[-1]
    course = []
    for target in commanded:
        now = now + (1 - lag) * (target - now)
        course.append(now)
    return np.array(course)
