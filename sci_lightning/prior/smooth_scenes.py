"""Statistics of scenes of which nothing is known but that they are smooth: for snapshots of no usual video."""

from __future__ import annotations

import itertools
import math

import torch

from sci_lightning.prior.prior import PatchPrior

LENGTHS = (3.0, 10.0)
"""Pixels over which texture is alike, by component."""
BACKGROUND = 60.0
"""Pixels over which brightness is alike."""
DURATIONS = (6.0, 30.0)
"""Slots over which a scene is alike, by component."""
CONTRASTS = (0.4, 1.2)
"""Standard deviations of texture and of brightness, as parts of the mean, by component."""


def smooth_scene_prior(frames: int, reach: int = 16, drift: tuple[int, int] = (0, 0)) -> PatchPrior:
    r"""Return a mixture of processes that differ in length, duration and contrast; their shares are to be estimated.

    With the displacement d from slot to slot the autocovariance of a component is

    .. math:: R(t, p) = s^2 e^{-|t| / \tau} \big(k_\ell(|p - d t|) + k_L(|p - d t|)\big), \qquad
        k_\ell(r) = (1 + r / \ell)\, e^{-r / \ell},

    the Matérn covariance of smoothness 3/2. The mean is 1.

    Args:
        frames: T.
        reach: largest displacement within a patch, in pixels.
        drift: d, (rows, columns) by which the scene moves on the sensor from slot to slot. It is that of the mask in a
            coded-aperture spectral camera, whose prism displaces both, and 0 in a camera for video.

    Source: Rasmussen and Williams, "Gaussian processes for machine learning", MIT Press 2006, Eq. 4.17.
    """
    time = torch.arange(frames, dtype=torch.float64)[:, None, None]
    place = torch.arange(-reach, reach + 1, dtype=torch.float64)
    distance = torch.hypot(place[:, None] - drift[0] * time, place - drift[1] * time)
    parts = []
    for length, duration, contrast in itertools.product(LENGTHS, DURATIONS, CONTRASTS):
        alike = _matern(distance / length) + _matern(distance / BACKGROUND)
        parts.append(contrast**2 * torch.exp(-time / duration) * alike)
    weights = torch.full((len(parts),), 1 / len(parts))
    return PatchPrior(1.0, weights, torch.stack(parts).float())


def _matern(distance: torch.Tensor) -> torch.Tensor:
    return (1 + distance) * torch.exp(-distance)


def pattern_drift(patterns: torch.Tensor, most: int = 4, tolerance: float = 1e-3) -> tuple[int, int]:
    """Return (rows, columns) by which every pattern is the one before, displaced; (0, 0) where that is not so.

    Args:
        patterns: ``(T, H, W)``.
        most: largest displacement that is looked for, in pixels.
        tolerance: root mean square difference up to which patterns count as the same.
    """
    patterns = patterns.float()
    inner = (slice(None), slice(most, patterns.shape[1] - most), slice(most, patterns.shape[2] - most))
    steps = itertools.product(range(-most, most + 1), repeat=2)
    for rows, columns in sorted(steps, key=lambda step: abs(step[0]) + abs(step[1])):
        followed = torch.roll(patterns, (-rows, -columns), (1, 2))[1:]
        if math.sqrt(float((patterns[:-1] - followed)[inner].square().mean())) < tolerance:
            return rows, columns
    return 0, 0
