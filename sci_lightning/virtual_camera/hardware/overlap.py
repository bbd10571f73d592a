"""How much light of one interval lands in another, through a blur."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

BEYOND = 1e4
"""Pixels: further out than any optics here reaches."""


def lit(z: np.ndarray, sigma: float) -> np.ndarray:
    r"""Light up to ``z`` behind an edge at 0 that a Gaussian blurs: :math:`\int_{-\infty}^z \Phi(s/\sigma)\,ds`."""
    if sigma == 0:
        return np.maximum(z, 0)
    return z * ndtr(z / sigma) + sigma / np.sqrt(2 * np.pi) * np.exp(-0.5 * (z / sigma) ** 2)


def overlap(targets: np.ndarray, sources: np.ndarray, sigma: float = 0.0) -> np.ndarray:
    """Light of each source interval, of irradiance 1, that falls into each target interval.

    In closed form: uniform sources, blurred by a Gaussian, integrated over the targets. Two-dimensional squares
    are products of two of these.

    Args:
        targets: (n + 1,) ascending edges.
        sources: (m + 1,) ascending edges.
        sigma: standard deviation of the blur, in the edges' unit; 0 for none.

    Returns:
        (n, m).
    """
    light = lit(targets[:, None] - sources[None, :], sigma)
    return np.maximum(np.diff(light[:, :-1] - light[:, 1:], axis=0), 0)  # rounding may leave -1e-16


def sources_with(surround: str, edges: np.ndarray) -> np.ndarray:
    """The edges of the sources when beyond the field it is ``dark``, or its ``edge`` goes on for ever."""
    if surround == "dark":
        return edges
    return np.concatenate(([edges[0] - BEYOND], edges[1:-1], [edges[-1] + BEYOND]))
