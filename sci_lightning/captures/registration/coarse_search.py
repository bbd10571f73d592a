"""The coarse search: pitch, rotation, mirroring and displacement of a modulator, from blurred images of its patterns.

Of every combination of pitch, aspect, rotation and mirroring the patterns are drawn as the sensor would see them, and
compared with their images at all displacements at once, by the normalised cross-correlation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter, map_coordinates

from sci_lightning.captures.captures import Captures
from sci_lightning.errors import BadInput

LEAST_CONTRAST = 0.01
"""Standard deviation of what is displayed, as a part of its mean, below which it shows no places."""
UNEVEN = 0.02
"""Standard deviation of a known scene, as a part of its mean, above which it is no even target."""
MOST_PATTERNS = 6
"""Patterns that are compared, those of most contrast: more do not say more about where they lie."""
FEWEST_DIFFERING = 3
"""Patterns whose differences show which part of the field sees the modulator."""
NEIGHBOURHOOD = 1 / 32
"""Standard deviation, in the field's longer side, of the blur over which these differences are averaged."""
SEEN = 0.1
"""Variance between the patterns, as a part of a high one, above which a pixel sees the modulator."""
NEARLY_ALL = 0.97
"""Part of the field from which it counts as whole."""


@dataclass(frozen=True)
class ShownPattern:
    """One displayed pattern and its image.

    Attributes:
        mirrors: (Hm, Wm) float32, what was displayed, summed over the slots; 1 where a mirror is on all the time.
        image: (H, W) float32, the mean of its captures, divided by that of an evenly lit modulator where there is one.
        captures: numbers of the captures.
        part: (H, W) bool, which pixels see the modulator; None for all of them, or where it is not known.
    """

    mirrors: np.ndarray
    image: np.ndarray
    captures: tuple[int, ...]
    part: np.ndarray | None = None

    def part_in(self, cells: tuple[slice, ...], shape: tuple[int, int, int, int]) -> np.ndarray | None:
        """Return :attr:`part` of a part of the field in cells of ``shape`` (rows, side, columns, side)."""
        return None if self.part is None else self.part[cells].reshape(shape).mean((1, 3)) > 0.5


def shown_patterns(captures: Captures) -> list[ShownPattern]:
    """Return the patterns with contrast that were shown to an even target, those of most contrast first.

    A capture of an unknown scene counts as one of an even target, as long as none of an even one shows a pattern.
    Captures that show the same are averaged. A capture of the same target with all mirrors on divides out uneven light.

    Raises:
        BadInput: no capture shows a pattern with contrast, or all of them show it to a known scene that is not even.
    """
    even, unknown = _grouped(captures)
    flat = _even_light(captures, even)
    shown = _with_contrast(captures, even, flat) or _with_contrast(captures, unknown, flat)
    if not shown:
        lit = [group for group in (*even, *unknown) if group[0].any()]
        what = (
            "every pattern that is shown to an even target is the same everywhere"
            if lit
            else "no pattern is shown to an even target or an unknown scene"
        )
        raise BadInput(
            f"{captures.path or captures.name}: {what}, so that nothing says where the mirrors lie; expected a capture "
            "of a pattern with contrast before an even target"
        )
    part = _differing(captures, shown[:MOST_PATTERNS])
    return [replace(pattern, part=part) for pattern in shown[:MOST_PATTERNS]]


def _differing(captures: Captures, shown: list[ShownPattern]) -> np.ndarray | None:
    """Return where patterns differ in their images, (H, W) bool: there the field sees the modulator, else its frame."""
    if len(shown) < FEWEST_DIFFERING:
        return None
    images = np.stack([captures.measurement[list(one.captures)].mean(0, dtype=np.float64) for one in shown])
    images /= images.mean((1, 2), keepdims=True).clip(1e-6)
    near = NEIGHBOURHOOD * max(captures.size)
    fine = images - gaussian_filter(images, (0, near, near), mode="nearest")  # leaking light differs, but smoothly
    variance = gaussian_filter(fine.var(0), near, mode="nearest")
    part = variance > SEEN * np.percentile(variance, 90)
    return part if part.mean() < NEARLY_ALL else None


Group = tuple[np.ndarray, list[int]]


def _grouped(captures: Captures) -> tuple[list[Group], list[Group]]:
    """Return what is displayed and the captures of it, for even targets and for unknown scenes."""
    even: dict[tuple[tuple[int, float], ...], list[int]] = {}
    unknown: dict[tuple[tuple[int, float], ...], list[int]] = {}
    for number, (sequence, scene) in enumerate(zip(captures.sequence, captures.scene, strict=True)):
        if captures.aperture[number] == 0:
            continue
        if not np.isfinite(scene).all():
            levels, groups = np.ones(len(sequence)), unknown
        else:
            levels, groups = scene.mean((1, 2)), even
            if not levels.any() or scene.std((1, 2)).max() > UNEVEN * levels.max():
                continue
        shares: dict[int, float] = {}
        for pattern, level in zip(sequence.tolist(), levels.tolist(), strict=True):
            shares[pattern] = shares.get(pattern, 0.0) + level / (float(levels.max()) * len(sequence))
        key = tuple(sorted((pattern, round(share, 6)) for pattern, share in shares.items()))
        groups.setdefault(key, []).append(number)

    def summed(groups: dict[tuple[tuple[int, float], ...], list[int]]) -> list[Group]:
        return [
            (sum((share * captures.patterns[pattern] for pattern, share in key), np.zeros(captures.mirrors)), numbers)
            for key, numbers in groups.items()
        ]

    return summed(even), summed(unknown)


def _contrast(mirrors: np.ndarray) -> float:
    mean = float(mirrors.mean())
    return float(mirrors.std()) / mean if mean > 0 else 0.0


def _even_light(captures: Captures, groups: list[Group]) -> np.ndarray | None:
    """Return the image (H, W) of an evenly lit modulator, of mean 1; None if there is none or it is saturated."""
    lit = [group for group in groups if group[0].mean() > 0.5 and _contrast(group[0]) < LEAST_CONTRAST]
    for _, numbers in lit:
        image = captures.measurement[numbers].mean(0)
        if 0 < image.mean() < 0.95 * captures.full_scale and image.min() > 0.05 * image.mean():
            return np.asarray(image / image.mean())
    return None


def _with_contrast(captures: Captures, groups: list[Group], flat: np.ndarray | None) -> list[ShownPattern]:
    shown = []
    for mirrors, numbers in groups:
        if _contrast(mirrors) > LEAST_CONTRAST:
            image = captures.measurement[numbers].mean(0, dtype=np.float64)
            image = image if flat is None else image / flat
            shown.append(ShownPattern(mirrors.astype(np.float32), image.astype(np.float32), tuple(numbers)))
    return sorted(shown, key=lambda one: -float(one.mirrors.std()))


CELLS = 64
"""Cells along the longer side of the field, in which images are compared."""
BLUR = 1.7
"""Standard deviation in cells of the blur on both: mistakes of 5 % in pitch and of 3 degrees then do little harm."""
BACKGROUND = 9.0
"""Standard deviation in cells of the background that is taken off both, because the light is uneven."""
LEAST_OVERLAP = 0.2
"""Part of the field that a displacement has to leave on the modulator."""
LARGEST_MODULATOR = 6
"""Times the field's side that the modulator's image may be long."""
PITCH_STEP, ANGLE_STEP = 1.1, 6.0
PATTERNS = 3
"""Patterns that are compared at all displacements."""


@dataclass(frozen=True)
class PlacementCandidate:
    """A place of the modulator.

    Attributes:
        matrix: (3, 3) homography from pixels to mirrors.
        score: correlation times the square root of the number of cells that it rests on.
    """

    matrix: np.ndarray
    score: float


@dataclass(frozen=True)
class Orientation:
    """How the mirrors lie, up to a displacement.

    Attributes:
        across, down: pixels from one mirror to the next, along its rows and its columns.
        angle: of the rows, degrees from +x towards +y.
        mirrored: whether u runs to the left before it is turned.
    """

    across: float
    down: float
    angle: float
    mirrored: bool

    @property
    def to_mirrors(self) -> np.ndarray:
        """(2, 2): a step in pixels (x, y) as a step in mirrors (u, v)."""
        cos, sin = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        turned = np.array([[cos, sin], [-sin, cos]])
        sign = -1.0 if self.mirrored else 1.0
        return np.asarray(np.diag([sign / self.across, 1 / self.down]) @ turned)


def likely_orientations(pitches: Iterable[tuple[float, float]]) -> Iterator[Orientation]:
    """Yield orientations whose rows are nearly upright or level, for every pitch (across, down)."""
    angles = [quarter + tilt for quarter in (0, 90, 180, 270) for tilt in (0, -ANGLE_STEP, ANGLE_STEP)]
    for (across, down), angle, mirrored in product(pitches, angles, (False, True)):
        yield Orientation(across, down, angle, mirrored)


def other_orientations(pitches: Iterable[tuple[float, float]]) -> Iterator[Orientation]:
    """Yield the orientations between those of :func:`likely_orientations`."""
    angles = [angle for angle in np.arange(0, 360, ANGLE_STEP).tolist() if ANGLE_STEP < angle % 90 < 90 - ANGLE_STEP]
    for (across, down), angle, mirrored in product(pitches, angles, (False, True)):
        yield Orientation(across, down, angle, mirrored)


def likely_pitches(field: tuple[int, int], mirrors: tuple[int, int], aspect: float = 1.0) -> list[tuple[float, float]]:
    """Return pitches (across, down) in pixels per mirror that show the field a good part of the modulator.

    Args:
        field: (H, W) in pixels.
        mirrors: (Hm, Wm).
        aspect: across over down.
    """
    smallest = math.sqrt(0.25 * math.prod(field) / math.prod(mirrors))
    largest = LARGEST_MODULATOR * max(field) / max(mirrors)
    largest = max(min(largest, min(field) / 8), smallest)
    steps = max(1, math.ceil(math.log(largest / smallest) / math.log(PITCH_STEP)))
    means = [smallest * (largest / smallest) ** (step / steps) for step in range(steps + 1)]
    return [(mean * math.sqrt(aspect), mean / math.sqrt(aspect)) for mean in means]


def band_pass(
    image: np.ndarray, cell: tuple[float, float], blur: float, box: bool = True, part: np.ndarray | None = None
) -> np.ndarray:
    """Return an image blurred by ``blur`` cells, less its background; beyond its edges nothing counts.

    Args:
        image: any image.
        cell: height and width of a cell in the image's own pixels.
        blur: standard deviation in cells.
        box: whether the mean over a cell is taken as well, which the other image has been through.
        part: bool, of the image's shape: the pixels that count; None for all of them.
    """

    counts = np.ones(image.shape, np.float32) if part is None else part.astype(np.float32)

    def blurred(sigma: float) -> np.ndarray:
        sigmas = [math.hypot(sigma * side, side / math.sqrt(12) if box else 0.0) for side in cell]
        weight = gaussian_filter(counts, sigmas, mode="constant", truncate=3)
        return np.asarray(gaussian_filter(image * counts, sigmas, mode="constant", truncate=3) / weight.clip(1e-6))

    return blurred(blur) - blurred(BACKGROUND)


class CoarseSearch:
    """Compares patterns with a square part of their images, in cells of ``size`` pixels.

    Args:
        shown: the patterns and their images.
        size: pixels along a cell's side.
    """

    def __init__(self, shown: list[ShownPattern], size: int) -> None:
        self._mirrors = [pattern.mirrors for pattern in shown[:PATTERNS]]
        self._cell = size
        height, width = shown[0].image.shape
        rows, columns = (min(CELLS, length // size) for length in (height, width))
        self._first = (height - rows * size) // 2, (width - columns * size) // 2
        self._shape = rows, columns
        (top, left), shape = self._first, (rows, size, columns, size)
        part = (slice(top, top + rows * size), slice(left, left + columns * size))
        binned = [pattern.image[part].reshape(shape).mean((1, 3)) for pattern in shown[:PATTERNS]]
        seen = shown[0].part_in(part, shape)
        self._seen = np.ones(self._shape) if seen is None else seen.astype(np.float64)
        self._images = [band_pass(image, (1.0, 1.0), BLUR, False, seen) * self._seen for image in binned]
        self._last: tuple[tuple[float, float], list[np.ndarray]] = ((0.0, 0.0), [])
        self._energy = np.sum([image**2 for image in self._images], 0)

    def _blurred(self, across: float, down: float) -> list[np.ndarray]:
        """Return the patterns as blurred as the images, for a pitch in pixels per mirror; the last is remembered."""
        if self._last[0] != (across, down):
            scale = self._cell / down, self._cell / across
            self._last = (across, down), [band_pass(mirrors, scale, BLUR) for mirrors in self._mirrors]
        return self._last[1]

    def best(self, orientation: Orientation) -> PlacementCandidate | None:
        """Return the best displacement of an orientation; None if the modulator is too small by it."""
        smooth = self._blurred(orientation.across, orientation.down)
        to_mirrors = orientation.to_mirrors * self._cell  # a step of one cell
        rows, columns = self._mirrors[0].shape
        centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
        half = np.abs(np.linalg.inv(to_mirrors)) @ (np.array([columns, rows]) / 2)
        width, height = (max(2, math.ceil(2 * side)) for side in half)
        x, y = np.arange(width) - (width - 1) / 2, np.arange(height)[:, None] - (height - 1) / 2
        u = centre[0] + to_mirrors[0, 0] * x + to_mirrors[0, 1] * y
        v = centre[1] + to_mirrors[1, 0] * x + to_mirrors[1, 1] * y
        on = ((u >= 0) & (u <= columns - 1) & (v >= 0) & (v <= rows - 1)).astype(np.float64)
        drawn = [map_coordinates(mirrors, [v, u], order=1, mode="nearest") * on for mirrors in smooth]
        shape = tuple(fft.next_fast_len(a + b, real=True) for a, b in zip(self._shape, on.shape, strict=True))

        def transformed(array: np.ndarray) -> np.ndarray:
            return np.asarray(fft.rfft2(array, shape))

        def correlated(fixed: np.ndarray, moved: np.ndarray) -> np.ndarray:
            return np.asarray(fft.irfft2(fixed * moved.conj(), shape))

        there = transformed(on)
        field = transformed(self._seen)
        cells = correlated(field, there)
        energy = correlated(transformed(self._energy), there)
        drawn_energy = correlated(field, transformed(np.sum([one**2 for one in drawn], 0)))
        product_ = sum(
            correlated(transformed(image), transformed(one)) for image, one in zip(self._images, drawn, strict=True)
        )
        enough = cells > LEAST_OVERLAP * math.prod(self._shape)
        if not enough.any():
            return None
        scale = np.sqrt(np.where(enough, energy * drawn_energy, np.inf).clip(1e-30))
        score = np.where(enough, product_ / scale, -1) * np.sqrt(cells.clip(0))
        peak = np.unravel_index(int(score.argmax()), score.shape)
        top, left = (  # the second half of the transform's period stands for negative displacements
            int(step) - length if step >= side else int(step)
            for step, length, side in zip(peak, shape, self._shape, strict=True)
        )
        # cell (i, j) of the field shows cell (i - top, j - left) of the drawing
        matrix = np.eye(3)
        matrix[:2, :2] = orientation.to_mirrors
        offset = np.array([-left - (width - 1) / 2, -top - (height - 1) / 2])
        first = np.array([self._first[1], self._first[0]]) + (self._cell - 1) / 2
        matrix[:2, 2] = centre + to_mirrors @ offset - orientation.to_mirrors @ first
        return PlacementCandidate(matrix, float(score[peak]))
