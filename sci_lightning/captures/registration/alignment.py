"""The alignment: a homography is improved until the patterns lie on their images, from coarse cells to fine ones.

In the last step a radial distortion is fitted beside it, so that a lens that distorts does not bend the homography.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates, spline_filter

from sci_lightning.captures.registration.coarse_search import CELLS, ShownPattern, band_pass
from sci_lightning.homography import on_modulator, pixels_per_mirror

MOST_CELLS = 512
"""Cells along the longer side in which the last steps compare; a finer grid adds digits that nobody needs."""
STEPS = 12
"""Steps of one level, at most."""
CONVERGED = 0.005
"""Cells by which a step moves the field's corners when a level is finished."""
LEAST_KEPT = 0.8
"""Part of what is compared that a level has to keep: fewer cells are easier to match."""
FINE = 1.0
"""Cells of blur below which mirrors are interpolated by splines."""
EDGE = 2
"""Cells at the edges of field and modulator that fine comparisons leave out: blurred images and patterns lack what lies
beyond."""
WORTH_DISTORTION = 0.05
"""Part of the squared difference that a radial distortion has to explain to be believed."""
MOST_DISTORTION = 0.3
"""Largest radial distortion that is believed, as that of ``mask_distortion``."""
NEWTON_STEPS = 6
"""Steps to undo a distortion."""
BLOCKS = 8
"""Blocks along either side of the field whose displacements make up the residual."""
FEWEST_REPLICATES = 3
"""Patterns from which their disagreement tells how noisy a block's displacement is."""


@dataclass(frozen=True)
class Level:
    """How finely is compared, and in which part of the field.

    Attributes:
        cell: pixels along a cell's side.
        part: largest part of the field that is compared, its middle.
        blur: standard deviation in cells.
        perspective: whether perspective is free as well.
        distortion: whether a radial distortion is free as well.
    """

    cell: int
    part: float
    blur: float
    perspective: bool = False
    distortion: bool = False


@dataclass(frozen=True)
class Alignment:
    """Where the mirrors are seen.

    Attributes:
        matrix: (3, 3) homography, from (x, y, 1) of a pixel's centre to (u, v, 1) in mirrors.
        distortion: what the homography shows at a distance r from the field's centre is seen at
            r (1 + distortion r^2 / R^2), where R is half the field's diagonal, as for ``mask_distortion``.
    """

    matrix: np.ndarray
    distortion: float = 0.0


@dataclass(frozen=True)
class AlignmentComparison:
    """Patterns as drawn by a homography beside their images.

    Attributes:
        drawn, image: ``(P, h, w)``, band-passed; 0 where the field is not on the modulator.
        along_u, along_v: ``(P, h, w)`` derivatives of what is drawn with respect to the place in mirrors.
        u, v: ``(h, w)`` places in mirrors.
        x, y: ``(h, w)`` places in pixels, without the distortion.
        bent: ``(2, h, w)`` derivatives of x and y with respect to the distortion.
        inside: ``(h, w)`` bool.
        cell: pixels along a cell's side.
    """

    drawn: np.ndarray
    image: np.ndarray
    along_u: np.ndarray
    along_v: np.ndarray
    u: np.ndarray
    v: np.ndarray
    x: np.ndarray
    y: np.ndarray
    bent: np.ndarray
    inside: np.ndarray
    cell: int

    @property
    def gains(self) -> np.ndarray:
        """(P, 1, 1): how bright every pattern's image is, by least squares."""
        energy = (self.drawn**2).sum((1, 2), keepdims=True).clip(1e-30)
        return np.asarray((self.drawn * self.image).sum((1, 2), keepdims=True) / energy)

    @property
    def correlation(self) -> float:
        """Normalised cross-correlation of all patterns with their images, -1 to 1."""
        scale = math.sqrt(float((self.drawn**2).sum() * (self.image**2).sum()))
        return float((self.drawn * self.image).sum()) / scale if scale > 0 else 0.0

    @property
    def significance(self) -> float:
        """The correlation in standard deviations of that of unrelated images with the same spectra (Bartlett)."""
        variance = sum(
            float((_autocorrelation(drawn) * _autocorrelation(image)).sum())
            for drawn, image in zip(self.drawn, self.image, strict=True)
        )
        return float((self.drawn * self.image).sum()) / math.sqrt(max(variance, 1e-30))

    def jacobian(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of (x, y) in pixels along u and v as ``(2, 2, h, w)``: [[u_x, u_y], [v_x, v_y]]."""
        depth = matrix[2, 0] * self.x + matrix[2, 1] * self.y + matrix[2, 2]
        rows = [
            [(matrix[i, j] - mirror * matrix[2, j]) / depth for j in (0, 1)] for i, mirror in ((0, self.u), (1, self.v))
        ]
        return np.array(rows[0]), np.array(rows[1])


def _autocorrelation(image: np.ndarray) -> np.ndarray:
    """Return the sums of the products of an image with itself, displaced by every distance."""
    shape = tuple(fft.next_fast_len(2 * length, real=True) for length in image.shape)
    spectrum = fft.rfft2(image, shape)
    return np.asarray(fft.irfft2(spectrum * spectrum.conj(), shape)) / math.sqrt(image.size)


def levels(field: tuple[int, int], cell: int, perspective: bool) -> list[Level]:
    """Return the levels of an alignment that starts from a coarse search with cells of ``cell`` pixels."""
    longest = max(field)
    part, steps = CELLS * cell / longest, [Level(cell, min(1.0, CELLS * cell / longest), 1.7)]
    while part < 1:
        part *= 1.6
        steps.append(Level(cell, min(part, 1.0), 1.7))
    while cell > 1 and longest / (cell / 2) <= MOST_CELLS:
        cell = max(1, cell // 2)
        steps.append(Level(cell, 1.0, 1.2))
    steps.append(Level(cell, 1.0, 0.8))
    if perspective:
        steps.append(Level(cell, 1.0, 0.8, True))
    return [*steps, Level(cell, 1.0, 0.8, perspective, True)]


def align(shown: list[ShownPattern], matrix: np.ndarray, steps: list[Level]) -> Alignment:
    """Return the homography that a start is improved to, level by level, by a damped Gauss-Newton method.

    It minimises the squared difference between images and patterns as drawn, each with its own brightness. A distortion
    that explains next to nothing is left out.
    """
    best = Alignment(matrix)
    for level in steps:
        prepared, start = PatternsAtLevel(shown, best.matrix, level), best
        damping, current = 1e-3, prepared.compare(best)
        before, least = current.correlation, LEAST_KEPT * float(current.inside.mean())
        for _ in range(STEPS):
            for more in range(4):
                proposal = _step(current, best, damping * 10.0**more, level)
                trial = prepared.compare(proposal)
                if trial.correlation > current.correlation and trial.inside.mean() > least:
                    break
            else:
                break
            moved = _corner_shift(current, best.matrix, proposal.matrix)
            best, current, damping = proposal, trial, max(damping * 10.0 ** (more - 1), 1e-6)
            if moved < CONVERGED:
                break
        if level.distortion and 1 - current.correlation**2 > (1 - WORTH_DISTORTION) * (1 - before**2):
            best = start
    return best


def _corner_shift(comparison: AlignmentComparison, before: np.ndarray, after: np.ndarray) -> float:
    """Return how far a step moves the corners of what is compared, in cells."""
    x, y = comparison.x[[0, 0, -1, -1], [0, -1, 0, -1]], comparison.y[[0, 0, -1, -1], [0, -1, 0, -1]]
    inverse = np.linalg.inv(after) / np.linalg.inv(after)[2, 2]
    back = on_modulator(inverse, *on_modulator(before, x, y))
    return float(np.hypot(back[0] - x, back[1] - y).max()) / comparison.cell


def _step(comparison: AlignmentComparison, start: Alignment, damping: float, level: Level) -> Alignment:
    """Return the alignment after one damped Gauss-Newton step."""
    x, y, inside = comparison.x, comparison.y, comparison.inside
    centre, half = np.array([x.mean(), y.mean()]), max(float(np.ptp(x)), float(np.ptp(y)), 1.0) / 2
    normal = np.array([[half, 0, centre[0]], [0, half, centre[1]], [0, 0, 1.0]])
    local = start.matrix @ normal
    local = local / local[2, 2]
    x, y = (x - centre[0]) / half, (y - centre[1]) / half
    depth = local[2, 0] * x + local[2, 1] * y + 1
    gains = comparison.gains
    along_u, along_v = gains * comparison.along_u / depth, gains * comparison.along_v / depth
    away = -(along_u * comparison.u + along_v * comparison.v)
    columns = [along_u * x, along_u * y, along_u, along_v * x, along_v * y, along_v]
    columns += [away * x, away * y] if level.perspective else []
    if level.distortion:
        along = [along_u * local[0, i] + along_v * local[1, i] + away * local[2, i] for i in (0, 1)]
        columns.append((along[0] * comparison.bent[0] + along[1] * comparison.bent[1]) / half)
    design = np.stack([column[:, inside].ravel() for column in columns])
    left = (comparison.image - gains * comparison.drawn)[:, inside].ravel()
    information = design @ design.T
    information += damping * np.diag(np.diag(information).clip(1e-12 * max(information.max(), 1e-30)))
    step = np.linalg.lstsq(information, design @ left, rcond=1e-10)[0]
    changed = local.copy()
    changed[0] += step[:3]
    changed[1] += step[3:6]
    if level.perspective:
        changed[2, :2] += step[6:8]
    moved = changed @ np.linalg.inv(normal)
    distortion = start.distortion + float(step[-1]) * level.distortion
    return Alignment(np.asarray(moved / moved[2, 2]), float(np.clip(distortion, -MOST_DISTORTION, MOST_DISTORTION)))


def _undistorted(
    x: np.ndarray, y: np.ndarray, field: tuple[int, int], distortion: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where what is seen at (x, y) would be seen without distortion, and ``(2, h, w)`` how that changes with it.

    Args:
        x, y: in pixels.
        field: (H, W).
        distortion: see :class:`Alignment`.
    """
    centre = (field[1] - 1) / 2, (field[0] - 1) / 2
    x, y = x - centre[0], y - centre[1]
    square = (x**2 + y**2) * (4 / (field[0] ** 2 + field[1] ** 2))
    part = np.ones_like(square)
    for _ in range(NEWTON_STEPS):  # part + distortion * square * part**3 = 1
        bend = distortion * square * part**2
        part = np.clip(part - (part + bend * part - 1) / np.maximum(1 + 3 * bend, 0.1), 0.5, 1.5)
    bent = -square * part**3 / np.maximum(1 + 3 * distortion * square * part**2, 0.1)
    return x * part + centre[0], y * part + centre[1], np.stack([x * bent, y * bent])


def _within(u: np.ndarray, v: np.ndarray, mirrors: tuple[int, int], margin: tuple[float, float]) -> np.ndarray:
    """Return which places in mirrors lie on the modulator, by a margin down and across at least."""
    down, across = (length - 1 - side for length, side in zip(mirrors, margin, strict=True))
    return np.asarray((u >= margin[1]) & (u <= across) & (v >= margin[0]) & (v <= down))


class PatternsAtLevel:
    """Images and patterns of a level, blurred alike.

    Args:
        shown: the patterns and their images.
        matrix: a homography that is right to some per cent, from which the mirrors' pitch is taken.
        level: how finely is compared.
    """

    def __init__(self, shown: list[ShownPattern], matrix: np.ndarray, level: Level) -> None:
        self._cell = level.cell
        field = (shown[0].image.shape[0], shown[0].image.shape[1])
        self._field = field
        self._fine = level.blur < FINE  # by splines: straight lines between mirrors would blur them a little more
        sides = [max(1, int(level.part * length) // level.cell) for length in field]
        first = [(length - side * level.cell) // 2 for length, side in zip(field, sides, strict=True)]
        part = tuple(slice(f, f + side * level.cell) for f, side in zip(first, sides, strict=True))
        y, x = (f + (level.cell - 1) / 2 + level.cell * np.arange(side) for f, side in zip(first, sides, strict=True))
        self._x, self._y = np.meshgrid(x, y)
        across, down = pixels_per_mirror(matrix, field)
        pitch = level.cell / down, level.cell / across
        self._margin = (EDGE * pitch[0], EDGE * pitch[1]) if self._fine else (0.0, 0.0)
        self._mirrors = [band_pass(pattern.mirrors, pitch, level.blur) for pattern in shown]
        self._slopes = [np.gradient(mirrors) for mirrors in self._mirrors]
        if self._fine:
            self._mirrors = [spline_filter(mirrors) for mirrors in self._mirrors]
            self._slopes = [[spline_filter(slope) for slope in slopes] for slopes in self._slopes]
        shape = (sides[0], level.cell, sides[1], level.cell)
        binned = (pattern.image[part].reshape(shape).mean((1, 3)) for pattern in shown)
        # the light that surrounds a modulator is no background of its patterns
        seen = shown[0].part_in(part, shape)
        if self._fine:
            half = pitch[0] / 2, pitch[1] / 2
            seen = _within(*on_modulator(matrix, self._x, self._y), shown[0].mirrors.shape, half)
        self._seen = np.ones_like(self._x, bool) if seen is None else seen
        self._images = np.stack([band_pass(image, (1.0, 1.0), level.blur, False, seen) for image in binned])

    def compare(self, alignment: Alignment) -> AlignmentComparison:
        """Return the patterns as an alignment draws them beside their images."""
        x, y, bent = _undistorted(self._x, self._y, self._field, alignment.distortion)
        u, v = on_modulator(alignment.matrix, x, y)
        rows, columns = self._mirrors[0].shape
        inside = _within(u, v, (rows, columns), self._margin) & self._seen
        if self._fine:
            inside[:EDGE] = inside[-EDGE:] = inside[:, :EDGE] = inside[:, -EDGE:] = False
        mirror = [np.where(inside, v, 0.0), np.where(inside, u, 0.0)]

        order = 3 if self._fine else 1

        def drawn(images: list[np.ndarray]) -> np.ndarray:
            return np.stack([map_coordinates(image, mirror, order=order, prefilter=False) * inside for image in images])

        return AlignmentComparison(
            drawn(self._mirrors),
            self._images * inside,
            drawn([slope[1] for slope in self._slopes]),
            drawn([slope[0] for slope in self._slopes]),
            mirror[1],
            mirror[0],
            x,
            y,
            bent,
            inside,
            self._cell,
        )


def residual(comparison: AlignmentComparison, matrix: np.ndarray) -> float:
    """Return how far the patterns still lie beside their images, in pixels.

    It is the root mean square of the displacements of blocks of the field, as far as these show a displacement. What
    the patterns of a block disagree about is noise of its displacement, and is subtracted where there are enough of
    them.
    """
    gains = comparison.gains
    (u_x, u_y), (v_x, v_y) = comparison.jacobian(matrix)
    left = comparison.image - gains * comparison.drawn
    slope = [gains * (comparison.along_u * a + comparison.along_v * b) for a, b in ((u_x, v_x), (u_y, v_y))]
    height, width = comparison.inside.shape
    entries, sides = [], [np.linspace(0, length, BLOCKS + 1).astype(int) for length in (height, width)]
    for top, bottom in zip(sides[0][:-1], sides[0][1:], strict=True):
        for first, last in zip(sides[1][:-1], sides[1][1:], strict=True):
            part = (slice(None), slice(top, bottom), slice(first, last))
            if bottom == top or last == first or not comparison.inside[part[1:]].all():
                continue
            design = np.stack([one[part].reshape(len(left), -1) for one in slope])
            entries.append((design, left[part].reshape(len(left), -1)))
    if not entries:
        return math.inf
    informations = [np.einsum("ipn,jpn->ij", design, design) for design, _ in entries]
    clear = np.array([np.linalg.eigvalsh(information)[0] for information in informations])
    squares = [
        _squared_shift(design, remainder, information)
        for (design, remainder), information, least in zip(entries, informations, clear, strict=True)
        if least > 0.1 * np.median(clear) and least > 0
    ]
    return math.sqrt(max(float(np.mean(squares)), 0.0)) if squares else math.inf


def _squared_shift(design: np.ndarray, left: np.ndarray, information: np.ndarray) -> float:
    """Return the squared displacement of a block, less what noise adds to it; negative where noise is all there is.

    Args:
        design: ``(2, P, n)`` derivatives along x and y.
        left: ``(P, n)`` what is to be explained.
        information: (2, 2) of the derivatives.
    """
    shift = np.linalg.solve(information, np.einsum("ipn,pn->i", design, left))
    count = len(left)
    if count < FEWEST_REPLICATES:
        return float(shift @ shift)
    disagreement = np.einsum("ipn,pn->pi", design, left - np.einsum("ipn,i->pn", design, shift))
    inverse = np.linalg.inv(information)
    noise = inverse @ (disagreement.T @ disagreement) @ inverse * count / (count - 1)
    return float(shift @ shift - np.trace(noise))
