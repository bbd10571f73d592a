"""Fitting the prior to clips: a mixture of Gaussians for small patches, then the autocovariance of each component."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from sci_lightning.errors import BadInput
from sci_lightning.prior.prior import FLOOR, PatchPrior

BLOCK, FRAMES = 8, 8
"""Pixels a side and frames of the patches that are sorted into components."""

MARGIN = 2
"""The autocovariance is estimated on patches that are larger by so many pixels on every side .."""

LAGS = 16
""".. and that last so many frames."""

LEAST_SHARE = 1e-3
"""Patches that belong to a component by a smaller share do not count for it."""


def fit_prior(
    clips: Sequence[torch.Tensor],
    components: int = 8,
    patches: int = 50_000,
    iterations: int = 10,
    seed: int = 0,
    on_progress: Callable[[str], object] = lambda line: None,
) -> PatchPrior:
    """Fit a mixture of stationary Gaussian processes to clips by expectation-maximisation.

    Patches of 8 x 8 pixels and 8 frames are sorted into components; patches are mirrored and reversed in time at
    random. The autocovariance of a component is then that of the larger patches around those that belong to it.

    Args:
        clips: videos ``(F, H, W)`` of at least 16 frames of 12 x 12 pixels, uint8 or float in [0, 1].
        components: K.
        patches: number of patches, evenly from all clips.
        iterations: of expectation-maximisation.
        seed: of the choice of patches.
        on_progress: called with a one-line message after every iteration.

    Raises:
        BadInput: no clips, or a clip that is too small.

    Source: Yang et al., "Video compressive sensing using Gaussian mixture models", IEEE Trans. Image Processing 2014;
    the stationary components are ours: they serve any T and block, and have 40 times fewer numbers.
    """
    generator = torch.Generator().manual_seed(seed)
    large = _sampled(clips, patches, generator)
    level = float(large.mean())
    large -= level
    late, side = (LAGS - FRAMES) // 2, slice(MARGIN, MARGIN + BLOCK)
    small = large[:, late : late + FRAMES, side, side].flatten(1)
    shares = _first_shares(small.unflatten(1, (FRAMES, BLOCK, BLOCK)), components, generator)
    for iteration in range(iterations):
        shares, likelihood = _sorted_anew(small, shares)
        on_progress(f"iteration {iteration + 1} of {iterations}: log-likelihood {likelihood:.4f} per value")
    autocovariance = torch.stack([_autocovariance(large, share) for share in shares.unbind(1)])
    return PatchPrior(level, shares.mean(0), autocovariance)


def _sampled(clips: Sequence[torch.Tensor], patches: int, generator: torch.Generator) -> torch.Tensor:
    """Return patches ``(P, LAGS, B, B)`` at random places of all clips, mirrored and reversed at random."""
    if not clips:
        raise BadInput("no clips to fit patch statistics to")
    side, samples = BLOCK + 2 * MARGIN, []
    for number, clip in enumerate(clips):
        if clip.ndim != 3 or clip.shape[0] < LAGS or min(clip.shape[1:]) < side:
            raise BadInput(
                f"clip {number} is {tuple(clip.shape)} (frames, height, width), expected at least {(LAGS, side, side)}"
            )
        windows = clip.unfold(0, LAGS, 1).unfold(1, side, 1).unfold(2, side, 1)
        count = -(-patches // len(clips))
        index = [torch.randint(length, (count,), generator=generator) for length in windows.shape[:3]]
        chosen = windows[index[0], index[1], index[2]].contiguous()
        chosen = chosen.float() / (255 if clip.dtype == torch.uint8 else 1)
        for dimension in (1, 2, 3):
            half = torch.rand(count, generator=generator) < 0.5
            chosen[half] = chosen[half].flip(dimension)
        samples.append(chosen)
    return torch.cat(samples)


def _first_shares(patches: torch.Tensor, components: int, generator: torch.Generator) -> torch.Tensor:
    """Return shares ``(P, K)`` by k-means of how much patches ``(P, T, B, B)`` change in time, down and across."""
    changes = [patches.diff(dim=dimension).square().mean((1, 2, 3)) for dimension in (1, 2, 3)]
    features = (torch.stack(changes, 1) + 1e-5).log()
    features = (features - features.mean(0)) / features.std(0).clamp(min=1e-6)
    centres = features[torch.randperm(len(features), generator=generator)[:components]]
    for _ in range(15):
        nearest = torch.cdist(features, centres).argmin(1)
        counts = nearest.bincount(minlength=components)
        sums = torch.zeros_like(centres).index_add_(0, nearest, features)
        centres = torch.where(counts[:, None] > 0, sums / counts.clamp(min=1)[:, None], centres)
    return torch.nn.functional.one_hot(nearest, components).float()


def _sorted_anew(patches: torch.Tensor, shares: torch.Tensor) -> tuple[torch.Tensor, float]:
    """Return the shares ``(P, K)`` after one iteration, and the mean log-likelihood of a value in nats."""
    values = patches.shape[1]
    likelihoods = []
    for share in shares.unbind(1):
        members = share > LEAST_SHARE
        weighted = patches[members] * share[members, None]
        covariance = weighted.mT @ patches[members] / share[members].sum().clamp(min=1) + FLOOR * torch.eye(values)
        factor = torch.linalg.cholesky(covariance)
        distance = ((patches @ torch.cholesky_inverse(factor)) * patches).sum(1)
        likelihoods.append(share.mean().clamp(min=1e-12).log() - factor.diagonal().log().sum() - 0.5 * distance)
    likelihood = torch.stack(likelihoods, 1)
    return likelihood.softmax(1), float(likelihood.logsumexp(1).mean()) / values


def _autocovariance(patches: torch.Tensor, share: torch.Tensor) -> torch.Tensor:
    """Return the autocovariance ``(LAGS, 2 L + 1, 2 L + 1)`` of patches ``(P, LAGS, B, B)``, weighted by shares."""
    lags, side = patches.shape[1:3]
    size = (2 * lags, 2 * side, 2 * side)
    members = (share > LEAST_SHARE).nonzero()[:, 0]
    power = torch.zeros(2 * lags, 2 * side, side + 1)
    for part in members.split(2000):
        power += (torch.fft.rfftn(patches[part], size).abs().square() * share[part, None, None, None]).sum(0)
    pairs = torch.fft.irfftn(torch.fft.rfftn(torch.ones(lags, side, side), size).abs().square(), size)
    sums = torch.fft.irfftn(power, size) / share[members].sum().clamp(min=1e-6)
    places = torch.arange(1 - side, side)
    return (sums / pairs.clamp(min=0.5))[:lags, places][:, :, places]
