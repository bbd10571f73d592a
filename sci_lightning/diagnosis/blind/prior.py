"""The prior of a scene in relative brightness, and its nuisance parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from pathlib import Path
from threading import Lock

import torch

from sci_lightning.data.reader import find_clips, read_clip
from sci_lightning.prior import PatchFactors, PatchPrior
from sci_lightning.prior.fit import fit_prior
from sci_lightning.prior.prior import FLOOR, fast_scene_prior, pattern_drift, read_prior, smooth_scene_prior

BLOCK = 8
"""Side of a block in pixels."""
MODES = 2
"""Modes of a patch that are kept, times the pixels of a block; the others count as noise of their own strength."""
LONGEST_VIDEO = 16
"""Slots over which the statistics of video reach."""
MOST_SLOTS = 64
"""Slots of the largest patches whose covariance is decomposed."""
SMOOTH_MODES = 4
"""As :data:`MODES`, for snapshots of more slots: scenes that move through a block have more modes."""
CONTRASTS = (0.25, 1.0, 4.0)
"""Variances of patches over those of many videos: places differ in contrast more than the components do. Chosen by the
likelihood of snapshots of validation clips behind known cameras (``python -m tests.diagnosis.blind.contrasts``)."""
UNCERTAIN_VIDEO_NATS, UNCERTAIN_SMOOTH_NATS = 0.01, 0.1
"""Nats per pixel within which a difference between cameras may be an error of the prior: about twice what further
components gain on validation clips, 0.0065 of statistics of video and 0.045 of smooth scenes (``python -m
tests.diagnosis.blind.contrasts``, with and without ``lengths``)."""
FAST_SHARE = 0.1
"""Share of scenes that move faster than those of the statistics: where estimating the shares begins."""
LEAST_SHARE = 0.01
"""Share of the blocks from which a component matters to these scenes."""
MATRICES = 48
"""Covariances of blocks that are handed out at a time: they stay in the processor's cache."""
ITERATIONS = 8
"""Iterations of expectation-maximisation for the shares; they start from those of many videos, and few are needed."""
PSEUDO_COUNT = 2.0
"""Blocks by which the shares of many videos hold on: a component that explains nothing keeps a small share."""


def scene_statistics(place: str | Path) -> PatchPrior:
    """Return statistics of patches of video: estimated from a folder of clips, or read from a file.

    Args:
        place: a folder of clips, or statistics that :meth:`PatchPrior.save` wrote.

    Raises:
        BadInput: the place cannot be read, or clips are too small or too short.
    """
    if not Path(place).is_dir():
        return read_prior(place)
    return fit_prior([torch.from_numpy(read_clip(path)) for path in find_clips(place)])


def statistics_for(frames: int, patterns: torch.Tensor | None = None) -> PatchPrior | None:
    """Return statistics of scenes behind T = ``frames`` slots; None where those of video reach over them.

    Of more slots nothing is known but that scenes are smooth. Where the patterns are one mask that moves, scenes may
    move with it, as in a coded-aperture spectral camera; both kinds are among the components, and the snapshots
    decide which of them they are made of.

    Args:
        frames: T.
        patterns: ``(T, H, W)`` of the slots, of which every value is a pixel; None for mirrors on a grid of their own.
    """
    if frames <= LONGEST_VIDEO:
        return None
    drifts = dict.fromkeys([(0, 0), (0, 0) if patterns is None else pattern_drift(patterns)])
    return PatchPrior.mixture([smooth_scene_prior(frames, drift=drift) for drift in drifts])


class ScenePrior:
    """A mixture of Gaussians for patches of a scene whose mean brightness is 1.

    The components differ in texture and motion, and each of them comes with several contrasts; which share of the
    blocks each of these K explains is the prior's nuisance parameter, and is estimated anew for every hypothesis about
    the camera. Scenes may move by up to six pixels a slot, faster than the clips from which the statistics come.

    Args:
        frames: T.
        statistics: of patches of video; None for those that come with the package.
        contrasts: variances at which each component comes, over its own; statistics of smooth scenes, for more than 16
            slots, have contrasts of their own.

    Attributes:
        weights: ``(K,)`` shares in many videos, of the components at one contrast after another.
        active: ``(K,)`` bool, the components that a likelihood is computed of.
        uncertainty_nats: per pixel, within which a difference in likelihood may be the prior's.
    """

    def __init__(
        self,
        frames: int,
        statistics: PatchPrior | None = None,
        contrasts: Sequence[float] = CONTRASTS,
    ) -> None:
        statistics = read_prior() if statistics is None else statistics
        order = statistics.weights.argsort(descending=True)
        shares, autocovariance = statistics.weights[order], statistics.autocovariance[order]
        shares, self._slow, self.uncertainty_nats = shares / shares.sum(), 0, UNCERTAIN_SMOOTH_NATS
        if frames <= LONGEST_VIDEO:
            self._slow, self.uncertainty_nats = len(shares), UNCERTAIN_VIDEO_NATS
            fast = fast_scene_prior(autocovariance.shape[1], statistics.reach)
            shares = torch.cat([(1 - FAST_SHARE) * shares, FAST_SHARE * fast.weights])
            autocovariance = torch.cat([autocovariance, statistics.level**2 * fast.autocovariance])
        self._statistics = PatchPrior(statistics.level, shares, autocovariance)
        self.frames = frames
        contrasts = contrasts if frames <= LONGEST_VIDEO else (1.0,)
        self._contrasts = torch.tensor(contrasts, dtype=torch.float64)
        self.weights = shares.double().repeat(len(contrasts)) / len(contrasts)
        self.active = torch.ones_like(self.weights, dtype=torch.bool)
        self._numbers = tuple(range(len(shares)))
        self._factors: dict[tuple[int, int], PatchFactors] = {}
        self._together: dict[int, PatchFactors] = {}
        self._lock = Lock()  # several threads may ask for factors at a time

    def of_these_scenes(self, weights: torch.Tensor) -> ScenePrior:
        """Return the same prior with fewer components: those of many videos, and whatever else has a share.

        Args:
            weights: ``(K,)`` shares by some hypothesis.
        """
        view, contrasts = copy(self), len(self._contrasts)
        active = (weights > LEAST_SHARE).view(contrasts, -1)
        active[(self._contrasts - 1).abs().argmin(), : self._slow] = True
        kept = active.any(0)
        view._numbers = tuple(kept.nonzero()[:, 0].tolist())
        view.weights, view.active = self.weights.view(contrasts, -1)[:, kept].flatten(), active[:, kept].flatten()
        view._together = {}
        return view

    def factors(self, block: int = BLOCK) -> PatchFactors:
        """Return the covariances of patches of mean 1, factored, for blocks of so many pixels a side."""
        with self._lock:
            if block not in self._together:
                missing = [number for number in self._numbers if (block, number) not in self._factors]
                if missing:
                    self._factors |= {(block, number): one for number, one in self._factored(block, missing)}
                every = [self._factors[block, number] for number in self._numbers]
                rest = torch.cat([one.rest for one in every])
                self._together[block] = PatchFactors(torch.cat([one.factors for one in every], 2).contiguous(), rest)
            return self._together[block]

    def _factored(self, block: int, numbers: list[int]) -> Iterator[tuple[int, PatchFactors]]:
        """Yield the numbers of components with their factors, which take most of the time of preparing a prior."""
        smooth, statistics = self.frames > LONGEST_VIDEO, self._statistics
        modes, power = (SMOOTH_MODES if smooth else MODES) * BLOCK**2, statistics.level**2
        some = PatchPrior(statistics.level, statistics.weights[numbers], statistics.autocovariance[numbers])
        covariance = some.covariance(self.frames, block, floor=0.0).double() / power
        factors = PatchFactors.of(covariance, modes, 0.0 if smooth else FLOOR / power)
        factors = factors.to(torch.float32)  # twice as fast, and precise enough; Cholesky's is not
        for place, number in enumerate(numbers):
            one = slice(place, place + 1)
            yield number, PatchFactors(factors.factors[:, :, one], factors.rest[one])

    def covariances(
        self, mask: torch.Tensor, operator: torch.Tensor | None, requested: torch.Tensor
    ) -> Iterator[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        """Yield covariances of blocks of a snapshot without noise, a few pairs of a component and a block at a time.

        Args:
            mask: relative mask of the blocks, ``(blocks, T, n)``; with pixels around them where there are optics.
            operator: how much of the light of every pixel reaches every pixel of a block, ``(m, n)``; None: its own.
            requested: ``(K, blocks)`` bool, the pairs that are computed.

        Yields:
            components ``(P,)`` and blocks ``(P,)`` of some pairs, in the order of ``requested.nonzero()``, and their
            covariances ``(P, m, m)``, float64.
        """
        by_contrast = requested.unflatten(0, (len(self._contrasts), -1))  # (contrasts, components, blocks)
        needed = by_contrast.any(0).mT
        covariance = self.factors(math.isqrt(mask.shape[2])).covariance_of(mask, operator, needed)
        place = needed.flatten().cumsum(0).view(needed.shape) - 1
        for pairs in by_contrast.nonzero().split(MATRICES):
            contrast, component, block = pairs.T
            scaled = covariance[place[block, component]].double().mul_(self._contrasts[contrast, None, None])
            yield contrast * by_contrast.shape[1] + component, block, scaled

    def estimate_weights(self, log_likelihood: torch.Tensor) -> torch.Tensor:
        """Return the shares of the components, ``(K,)``, from the log-likelihoods ``(K, blocks)`` of blocks."""
        weights = self.weights
        for _ in range(ITERATIONS):
            shares = (log_likelihood + weights.log()[:, None]).softmax(0)
            weights = shares.sum(1) + PSEUDO_COUNT * self.weights
            weights = weights / weights.sum()
        return weights
