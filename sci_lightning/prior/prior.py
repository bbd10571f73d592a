"""The prior: mean and covariance of patches of video, shipped with the package or read from a file."""

from __future__ import annotations

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
    def lags(self) -> int:
        """The number of frames that the statistics reach over."""
        return self.autocovariance.shape[1]

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
        time, place = torch.arange(frames), torch.arange(block)
        dt = time[:, None] - time + frames - 1
        dp = place[:, None] - place + self.reach
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
