"""The prior: mean and covariance of patches of video, shipped, read from a file, or those of any smooth scenes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write

SHIPPED = Path(__file__).with_name("statistics.npz")
"""Statistics of clips whose licence allows passing them on, see ``docs/explanation/linear-estimate.md``."""

FLOOR = 3e-4
"""Smallest eigenvalue of a patch covariance, 1.7 % of full scale: what statistics of a few clips cannot resolve."""

LARGEST = 4096
"""Largest number of values in a patch."""


@dataclass(frozen=True)
class PatchPrior:
    r"""A mixture of stationary Gaussian processes with one mean level, cut into patches of any size.

    A component k of weight w_k has the autocovariance :math:`R_k(\Delta t, \Delta y, \Delta x)`; the covariance of two
    values of a patch is R_k at their distance. One file so serves every number of frames and every size of block, and
    the covariance of the mixture as one Gaussian is :math:`\sum_k w_k R_k`.

    Attributes:
        level: mean of the video, 1.0 is full scale.
        weights: w, ``(K,)``, sum 1.
        autocovariance: R, float32 ``(K, lags, 2 L + 1, 2 L + 1)`` for time differences from 0 and displacements from
            -L to L pixels, rows first; R(-t, -y, -x) = R(t, y, x).
    """

    level: float
    weights: torch.Tensor
    autocovariance: torch.Tensor

    @property
    def reach(self) -> int:
        """L, the largest displacement, in pixels."""
        return self.autocovariance.shape[2] // 2

    @staticmethod
    def mixture(priors: Sequence[PatchPrior]) -> PatchPrior:
        """Return the mixture, in equal parts, of priors of one level that reach equally far."""
        weights = torch.cat([prior.weights for prior in priors]) / len(priors)
        return PatchPrior(priors[0].level, weights, torch.cat([prior.autocovariance for prior in priors]))

    def merged(self) -> PatchPrior:
        """Return the one Gaussian of the same mean and covariance."""
        mean = torch.einsum("k,ktyx->tyx", self.weights, self.autocovariance)
        return PatchPrior(self.level, torch.ones(1), mean[None])

    def covariance(self, frames: int, block: int, floor: float = FLOOR) -> torch.Tensor:
        """Return the covariance of patches of T = ``frames`` frames and B = ``block`` pixels a side.

        Beyond the frames that the statistics reach over, correlations go on falling at their last rate.

        Args:
            frames: T.
            block: B.
            floor: smallest eigenvalue; 0 for autocovariances that are positive definite as they are, which saves the
                decomposition.

        Returns:
            float32 ``(K, T, n, T, n)`` with n = B * B, positive definite.

        Raises:
            BadInput: the block is larger than the statistics reach, or the patch has too many values.
        """
        if block > self.reach + 1:
            raise BadInput(
                f"block={block}: the patch statistics reach over {self.reach + 1} pixels; choose at most that"
            )
        if frames * block**2 > LARGEST:
            raise BadInput(
                f"patches of {block} x {block} pixels and {frames} frames have {frames * block**2:,} values, at most "
                f"{LARGEST:,} are possible; choose a smaller block"
            )
        later = _extended(self.autocovariance, frames)
        both = torch.cat([later[:, 1:].flip(1, 2, 3), later], dim=1)
        time, pixel = torch.arange(frames), torch.arange(block)
        dt = time[:, None] - time + frames - 1
        dp = pixel[:, None] - pixel + self.reach
        patches = both[
            :,
            dt[:, None, None, :, None, None],
            dp[None, :, None, None, :, None],
            dp[None, None, :, None, None, :],
        ]
        values = frames * block**2
        full = patches.reshape(-1, values, values).double()
        if not floor:
            return full.float().reshape(-1, frames, block**2, frames, block**2)
        eigenvalues, vectors = torch.linalg.eigh(full)
        full = (vectors * eigenvalues.clamp(min=floor).unsqueeze(1)) @ vectors.mT
        return full.float().reshape(-1, frames, block**2, frames, block**2)

    def save(self, path: str | Path) -> None:
        """Write the prior as .npz, which :func:`read_prior` reads."""
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(
                stream,
                level=np.float64(self.level),
                weights=self.weights.numpy().astype(np.float32),
                autocovariance=self.autocovariance.numpy().astype(np.float32),
            )


def read_prior(path: str | Path | None = None) -> PatchPrior:
    """Read a prior that :meth:`PatchPrior.save` wrote; None reads the one that comes with the package.

    Raises:
        BadInput: the file is missing, or holds something else.
    """
    return _read(Path(SHIPPED if path is None else path))


@lru_cache(maxsize=4)
def _read(path: Path) -> PatchPrior:
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the patch statistics that fit_prior wrote (.npz)")
    try:
        with np.load(path, allow_pickle=False) as content:
            level = float(content["level"])
            weights, autocovariance = (
                torch.from_numpy(content[name].astype(np.float32)) for name in ("weights", "autocovariance")
            )
    except (OSError, KeyError, ValueError, EOFError, TypeError, AttributeError) as error:
        raise BadInput(f"{path}: not patch statistics ({type(error).__name__}); give what fit_prior wrote") from error
    sides = autocovariance.shape[2:]
    if (
        autocovariance.ndim != 4
        or weights.shape != autocovariance.shape[:1]
        or sides[0] != sides[1]
        or not sides[0] % 2
    ):
        raise BadInput(
            f"{path}: weights {tuple(weights.shape)} and autocovariance {tuple(autocovariance.shape)}, expected (K,) "
            "and (K, lags, 2 L + 1, 2 L + 1)"
        )
    if not (autocovariance.isfinite().all() and weights.isfinite().all()):
        raise BadInput(f"{path}: the patch statistics hold NaN or infinite values")
    return PatchPrior(level, weights / weights.sum(), autocovariance)


def _extended(autocovariance: torch.Tensor, frames: int) -> torch.Tensor:
    """Return the autocovariance at ``frames`` time differences from 0, beyond its last one by geometric decay."""
    lags = autocovariance.shape[1]
    if frames <= lags or lags < 2:
        last = autocovariance[:, -1:].expand(-1, max(0, frames - lags), -1, -1)
        return torch.cat([autocovariance[:, :frames], last], dim=1)
    middle = autocovariance.shape[2] // 2
    rate = (autocovariance[:, -1, middle, middle] / autocovariance[:, -2, middle, middle]).clamp(0, 1)
    steps = torch.arange(1, frames - lags + 1)
    tail = autocovariance[:, -1:] * (rate[:, None] ** steps)[:, :, None, None]
    return torch.cat([autocovariance, tail], dim=1)


LENGTHS = (1.5, 4.0, 10.0)
"""Pixels over which texture is alike, by component. Chosen by the likelihood of snapshots of validation clips behind
known cameras, see ``docs/results/blind-lengths.json``."""
BACKGROUND = 60.0
"""Pixels over which brightness is alike."""
DURATIONS = (6.0, 30.0)
"""Slots over which a scene is alike, by component."""
CONTRASTS = (0.4, 1.2)
"""Standard deviations of texture and of brightness, as parts of the mean, by component."""
FAST = ((1.0, 1.5, 2.0), (2.5, 3.0, 3.5), (4.0, 5.0, 6.0))
"""Pixels by which a fast scene glides from slot to slot: the speeds of every component."""
DIRECTIONS = 8
"""Directions in which it glides, a component for each."""
FAST_LENGTH, LASTING = 3.0, 200.0
"""Pixels over which the texture of a scene is alike that does nothing but glide, and slots over which the scene is."""


def smooth_scene_prior(
    frames: int, reach: int = 16, drift: tuple[int, int] = (0, 0), lengths: Sequence[float] = LENGTHS
) -> PatchPrior:
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
        lengths: in pixels, over which texture is alike, by component.

    Source: Rasmussen and Williams, "Gaussian processes for machine learning", MIT Press 2006, Eq. 4.17.
    """
    parts = [
        contrast**2 * _gliding(frames, reach, drift, length, duration)
        for length, duration, contrast in itertools.product(lengths, DURATIONS, CONTRASTS)
    ]
    weights = torch.full((len(parts),), 1 / len(parts))
    return PatchPrior(1.0, weights, torch.stack(parts).float())


def fast_scene_prior(frames: int, reach: int = 16) -> PatchPrior:
    """Return components of scenes that glide, one for each range of speeds of :data:`FAST` and each direction.

    A component's autocovariance is the mean over its speeds of what :func:`smooth_scene_prior` states for a
    displacement from slot to slot. The mean is 1.

    Args:
        frames: T.
        reach: largest displacement within a patch, in pixels.
    """
    parts = []
    for speeds, step in itertools.product(FAST, range(DIRECTIONS)):
        down, across = (turn(2 * math.pi * step / DIRECTIONS) for turn in (math.sin, math.cos))
        every = [_gliding(frames, reach, (speed * down, speed * across), FAST_LENGTH, LASTING) for speed in speeds]
        parts.append(CONTRASTS[0] ** 2 * torch.stack(every).mean(0))
    return PatchPrior(1.0, torch.full((len(parts),), 1 / len(parts)), torch.stack(parts).float())


def _gliding(frames: int, reach: int, drift: tuple[float, float], length: float, duration: float) -> torch.Tensor:
    """Return the autocovariance of :func:`smooth_scene_prior` for a contrast of 1, ``(T, 2 L + 1, 2 L + 1)``."""
    time = torch.arange(frames, dtype=torch.float64)[:, None, None]
    pixel = torch.arange(-reach, reach + 1, dtype=torch.float64)
    distance = torch.hypot(pixel[:, None] - drift[0] * time, pixel - drift[1] * time)
    return torch.exp(-time / duration) * (_matern(distance / length) + _matern(distance / BACKGROUND))


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
