"""How much light of one interval lands in another one after a Gaussian blur, in closed form."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

FAR_AWAY = 1e4
"""Pixels. A border moved this far out lies beyond the reach of every blur that the virtual camera has."""


def light_below(z: np.ndarray, sigma: float | np.ndarray) -> np.ndarray:
    r"""Return the light below ``z`` when all light above 0 is blurred by a Gaussian.

    This is :math:`\int_{-\infty}^z \Phi(s/\sigma)\,ds`, or :math:`\max(z, 0)` without a blur.

    Args:
        z: positions, in any unit.
        sigma: standard deviation of the blur in that unit, 0 for none.
    """
    if np.ndim(sigma) == 0 and sigma == 0:
        return np.maximum(z, 0)
    return z * ndtr(z / sigma) + sigma / np.sqrt(2 * np.pi) * np.exp(-0.5 * (z / sigma) ** 2)


def overlap(targets: np.ndarray, sources: np.ndarray, sigma: float = 0.0) -> np.ndarray:
    """Return the light of each source interval, of irradiance 1, that falls into each target interval.

    Uniform sources are blurred by a Gaussian and integrated over the targets, in closed form. For squares in two
    dimensions, multiply the results of both axes.

    Args:
        targets: (n + 1,) ascending edges.
        sources: (m + 1,) ascending edges.
        sigma: standard deviation of the blur in the edges' unit, 0 for none.

    Returns:
        (n, m).
    """
    light = light_below(targets[:, None] - sources[None, :], sigma)
    return np.maximum(np.diff(light[:, :-1] - light[:, 1:], axis=0), 0)  # rounding may leave -1e-16


def one_by_one(targets: np.ndarray, left: np.ndarray, right: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return the light of sources, each blurred by a Gaussian of its own, that falls into each target interval.

    Args:
        targets: (n + 1,) ascending edges.
        left, right: (m,) edges of the sources.
        sigma: (m,) standard deviations in the edges' unit.

    Returns:
        (n, m).
    """
    sigma = np.maximum(sigma, 1e-9)
    light = light_below(targets[:, None] - left, sigma) - light_below(targets[:, None] - right, sigma)
    return np.maximum(np.diff(light, axis=0), 0)


def with_surround(surround: str, edges: np.ndarray) -> np.ndarray:
    """Return the edges of the sources with the first and last moved outwards if the field's ``edge`` goes on.

    Args:
        surround: ``dark`` leaves the edges as they are, ``edge`` extends the outermost sources.
        edges: (m + 1,) ascending edges, pixel.
    """
    if surround == "dark":
        return edges
    return np.concatenate(([edges[0] - FAR_AWAY], edges[1:-1], [edges[-1] + FAR_AWAY]))
