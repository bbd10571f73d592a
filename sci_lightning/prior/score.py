"""The score of a mask: the error that the best linear decoder is expected to make behind it, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import torch

from sci_lightning.errors import BadInput
from sci_lightning.prior.moments import block_covariance
from sci_lightning.prior.prior import LARGEST, PatchPrior, read_prior

BLOCK = 8
"""Side of the blocks in pixels."""

MOST_SLOTS = LARGEST // BLOCK**2
"""Slots of the largest masks whose patches have statistics."""

MOST_BLOCKS = 256
"""Blocks of a mask that are looked at; of more blocks, so many at equal distances."""


NO_NOISE = 1e-9
"""Variance of a pixel, of full scale 1.0, below which noise makes no difference: a thousandth of 8-bit rounding."""


@dataclass(frozen=True)
class SensorNoise:
    """The noise of a sensor: that of rounding, of reading, and of photons.

    Attributes:
        bit_depth: of the converter; None for a sensor that does not round.
        read_noise: standard deviation in DN; of 8 bits where the sensor does not round.
        full_well: electrons at full scale; None for no photon noise.

    Raises:
        BadInput: a number out of its range.
    """

    bit_depth: int | None = 8
    read_noise: float = 0.0
    full_well: float | None = None

    def __post_init__(self) -> None:
        if self.bit_depth is not None and not 1 <= self.bit_depth <= 16:
            raise BadInput(f"bit_depth={self.bit_depth}: must be a whole number from 1 to 16, or null")
        if not 0 <= self.read_noise < float("inf"):
            raise BadInput(f"read_noise={self.read_noise}: must be a standard deviation in DN, 0 or more")
        if self.full_well is not None and not 0 < self.full_well < float("inf"):
            raise BadInput(f"full_well={self.full_well}: must be a positive number of electrons, or null")

    def variance(self, light: torch.Tensor) -> torch.Tensor:
        """Return the variance of a measurement, of full scale 1.0, for mean light ``(..)``."""
        step = 1 / (2 ** (self.bit_depth or 8) - 1)
        rounding = 1 / 12 if self.bit_depth else 0.0
        variance = torch.full_like(light, step**2 * (rounding + self.read_noise**2))
        return variance if self.full_well is None else variance + light / self.full_well


class MaskScore:
    r"""The expected PSNR of the best linear decoder behind a mask, differentiable in the mask.

    For a block with the mask matrix A, patches of covariance C and noise of covariance N, the mean square error that no
    linear decoder of this block can undercut is

    .. math:: \tfrac{1}{n T} \mathrm{tr}\big(W (C - C A^\top (A C A^\top + N)^{-1} A C)\big),

    where W holds the weights of a block's pixels in the blend of overlapping blocks (their mean is 1). The score is
    this error, averaged over blocks, in dB. Light that a bright scene loses to clipping is not counted.

    Args:
        frames: T.
        noise: of the sensor.
        prior: of patches; None for the statistics that come with the package.
        aperture: scale of the light before the sensor; None takes 1 over the mean of the mask's sum over time, so that
            a white scene fills the sensor on average.

    Raises:
        BadInput: an aperture that is not positive.

    Source: the posterior covariance of a Gaussian, as in any textbook of estimation theory; for compressive sensing
    matrices for instance Carson, Chen, Rodrigues, Calderbank and Carin, "Communications-inspired projection design with
    application to compressive sensing", SIAM J. Imaging Sciences 2012.
    """

    def __init__(
        self,
        frames: int,
        noise: SensorNoise | None = None,
        prior: PatchPrior | None = None,
        aperture: float | None = None,
    ) -> None:
        if aperture is not None and not aperture > 0:
            raise BadInput(f"aperture={aperture}: must be positive")
        self.aperture = aperture
        self.noise = noise or SensorNoise()
        statistics = (prior or read_prior()).merged()
        self.level = statistics.level
        self.moments = _moments(frames) if prior is None else _weighted(statistics, frames)

    def __call__(self, mask: torch.Tensor) -> torch.Tensor:
        """Return the scores, ``(..)`` in dB, of masks ``(.., T, H, W)`` that are repeated in all directions.

        Args:
            mask: in [0, 1], a tile or a whole mask.

        Raises:
            BadInput: a mask of another number of frames.
        """
        matrices, total = self.moments
        frames = matrices.shape[1]
        if mask.shape[-3] != frames:
            raise BadInput(f"the mask has {mask.shape[-3]} slots, the score was made for {frames}")
        mask = mask.double()
        light = mask.sum(-3).mean((-2, -1)).clamp(min=1e-9)
        scale = 1 / light if self.aperture is None else torch.full_like(light, self.aperture)
        blocks = _blocks(mask)
        flat = blocks.flatten(0, -3)
        scales = scale[..., None].expand(blocks.shape[:-2]).flatten()[:, None]
        # without any noise, a pixel that never opens would make the matrix below singular
        variance = (self.noise.variance(self.level * flat.sum(1) * scales) / scales.square()).clamp(min=NO_NOISE)
        signal, gain = block_covariance(flat, matrices)
        inverse = torch.cholesky_inverse(torch.linalg.cholesky(signal + torch.diag_embed(variance)))
        explained = (inverse * gain).sum((-2, -1)) / (frames * BLOCK**2)
        error = total - explained.unflatten(0, blocks.shape[:-2]).mean(-1)
        return -10 * error.clamp(min=1e-10).log10()


class _Moments(NamedTuple):
    matrices: torch.Tensor
    """C, and C W C, which gives the explained variance with the inverse of A C A' + N: ``(2, T, n, T, n)``."""
    total: torch.Tensor
    """tr(W C) / (n T)."""


@lru_cache(maxsize=8)
def _moments(frames: int) -> _Moments:
    return _weighted(read_prior().merged(), frames)


def _weighted(prior: PatchPrior, frames: int) -> _Moments:
    centres = (torch.arange(BLOCK, dtype=torch.double) + 0.5) / BLOCK
    profile = torch.sin(torch.pi * centres).square()
    window = (profile[:, None] * profile).flatten()
    weights = (window / window.mean()).repeat(frames)
    covariance = prior.covariance(frames, BLOCK).double()
    whole = covariance.reshape(len(weights), len(weights))
    gains = ((whole * weights) @ whole).reshape(covariance.shape)
    return _Moments(torch.cat([covariance, gains]), (weights * whole.diagonal()).mean())


def _blocks(mask: torch.Tensor) -> torch.Tensor:
    """Return blocks ``(.., blocks, T, n)`` of masks ``(.., T, H, W)`` that are repeated in all directions."""
    height, width = mask.shape[-2:]
    step = max(1, BLOCK // 2)
    while -(-height // step) * -(-width // step) > MOST_BLOCKS:
        step += 1
    inside = torch.arange(BLOCK)
    rows, columns = ((torch.arange(0, side, step)[:, None] + inside) % side for side in (height, width))
    cut = mask[..., rows[:, None, :, None], columns[None, :, None, :]]
    return cut.flatten(-2).flatten(-3, -2).transpose(-3, -2)
