"""Homographies from a sensor's pixels to a modulator's mirrors: what one means, and whether it can be meant.

A homography maps homogeneous (x, y, 1) of a pixel's centre to (u, v, 1) in mirrors, up to a factor. x and u count to
the right, y and v down, all from 0 at the first centre: the field of (H, W) pixels reaches from -0.5 to W - 0.5.
Only NumPy is needed.
"""

from __future__ import annotations

import numpy as np

from sci_lightning.errors import BadInput

LEAST_COVERED = 0.25
"""Smallest part of the field's pixels that have to lie on the modulator; a diagnosis needs about as much of a field."""
LEAST_PITCH, LARGEST_PITCH = 1 / 64, 64.0
"""Mirrors per pixel, in geometric mean, that a homography may have: beyond, its units are others."""


def on_modulator(matrix: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (u, v), the places on the modulator that pixels at (x, y) see; infinite where they see none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
        depth = np.where(depth * np.sign(matrix[2, 2] or 1.0) > 0, depth, np.nan)
        u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / depth
        v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / depth
    return np.where(np.isfinite(u), u, np.inf), np.where(np.isfinite(v), v, np.inf)


def covered(matrix: np.ndarray, field: tuple[int, int], mirrors: tuple[int, int]) -> np.ndarray:
    """Return ``(H, W)`` bool: which pixels' centres lie on the modulator.

    Args:
        matrix: (3, 3) homography.
        field: (H, W) in pixels.
        mirrors: (Hm, Wm).
    """
    y, x = np.arange(field[0])[:, None], np.arange(field[1])[None]
    u, v = on_modulator(matrix, x, y)
    return (u >= -0.5) & (u <= mirrors[1] - 0.5) & (v >= -0.5) & (v <= mirrors[0] - 0.5)


def check_homography(matrix: np.ndarray, field: tuple[int, int], mirrors: tuple[int, int]) -> None:
    """Check that a homography shows a field enough of the modulator.

    Args:
        matrix: (3, 3) homography.
        field: (H, W) in pixels.
        mirrors: (Hm, Wm).

    Raises:
        BadInput: not finite, singular (or so nearly that a pixel sees nothing or everything), the field lies off the
            modulator, or the patterns cover less than a quarter of it.
    """
    (height, width), (rows, columns) = field, mirrors
    expected = "expected 3 x 3 finite numbers that map a pixel's (x, y, 1) to a mirror's (u, v, 1)"
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise BadInput(f"sensor_to_modulator: {expected}")
    scale = np.abs(matrix).max()
    singular = scale == 0 or np.linalg.matrix_rank(matrix / scale) < 3
    corners = [(x, y) for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)]
    depths = [float(matrix[2] @ (x, y, 1)) for x, y in corners]
    if singular or min(depths) * max(depths) <= 0:
        what = "is singular" if singular else "maps a part of the field to infinity"
        raise BadInput(f"sensor_to_modulator: the homography {what}; {expected}")
    pitch = abs(np.linalg.det(matrix) / float(matrix[2] @ ((width - 1) / 2, (height - 1) / 2, 1)) ** 3) ** 0.5
    if not LEAST_PITCH <= pitch <= LARGEST_PITCH:
        raise BadInput(
            f"sensor_to_modulator: {pitch:.3g} mirrors per pixel at the field's centre, expected {LEAST_PITCH:.2g} to "
            f"{LARGEST_PITCH:g}; it maps pixels to mirrors, not mirrors to pixels"
        )
    part = float(covered(matrix, field, mirrors).mean())
    if part == 0:
        raise BadInput(
            f"sensor_to_modulator: it maps the field of {height} x {width} pixels off the modulator of {rows} x "
            f"{columns} mirrors; expected at least {LEAST_COVERED:.0%} of the pixels on it"
        )
    if part < LEAST_COVERED:
        raise BadInput(
            f"'patterns' of {rows} x {columns} mirrors are too small for the field: by 'sensor_to_modulator' they "
            f"cover {part:.1%} of its {height} x {width} pixels, expected at least {LEAST_COVERED:.0%}"
        )


def nearest_mirrors(patterns: np.ndarray, matrix: np.ndarray, field: tuple[int, int]) -> np.ndarray:
    """Return ``(P, H, W)``: of patterns ``(P, Hm, Wm)`` the mirror that every pixel's centre lies on, 0 beyond them.

    For a look at them; :class:`~sci_lightning.encoder.modulator_grid.ModulatorGrid` says how light is summed.
    """
    y, x = np.arange(field[0])[:, None], np.arange(field[1])[None]
    u, v = on_modulator(matrix, x, y)
    inside = covered(matrix, field, (patterns.shape[1], patterns.shape[2]))
    row, column = (np.where(inside, np.rint(place), 0).astype(int) for place in (v, u))
    row, column = row.clip(0, patterns.shape[1] - 1), column.clip(0, patterns.shape[2] - 1)
    return np.asarray(patterns[:, row, column] * inside)


def pixels_per_mirror(matrix: np.ndarray, field: tuple[int, int]) -> tuple[float, float]:
    """Return how many pixels apart neighbouring mirrors are in the field's centre, along a row and along a column."""
    x, y = np.array([0.0, 1.0, 0.0]) + (field[1] - 1) / 2, np.array([0.0, 0.0, 1.0]) + (field[0] - 1) / 2
    u, v = on_modulator(matrix, x, y)
    steps = np.linalg.inv([[u[1] - u[0], u[2] - u[0]], [v[1] - v[0], v[2] - v[0]]])
    return float(np.hypot(*steps[:, 0])), float(np.hypot(*steps[:, 1]))
