"""The prior of a scene in relative brightness, and its nuisance parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from sci_lightning.data.reader import find_clips, read_clip
from sci_lightning.imaging.patches import PatchFactors, PatchPrior
from sci_lightning.imaging.patches.fit import fit_prior
from sci_lightning.imaging.patches.prior import read_prior
from sci_lightning.imaging.patches.smooth_scenes import pattern_drift, smooth_scene_prior

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
likelihood of snapshots of validation clips behind known cameras, see ``docs/results/blind-contrasts.json``."""
ITERATIONS = 8
"""Iterations of expectation-maximisation for the shares; they start from those of many videos, and few are needed."""
PSEUDO_COUNT = 2.0
"""Blocks by which the shares of many videos hold on: a component that nothing asks for keeps a small share."""


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
    the camera.

    Args:
        frames: T.
        statistics: of patches of video; None for those that come with the package.
        components: how many components are kept, those with the largest shares; None for all.
        contrasts: variances at which each component comes, over its own; statistics of smooth scenes, for more than 16
            slots, have contrasts of their own.

    Attributes:
        weights: ``(K,)`` shares in many videos, of the components at one contrast after another.
    """

    def __init__(
        self,
        frames: int,
        statistics: PatchPrior | None = None,
        components: int | None = None,
        contrasts: Sequence[float] = CONTRASTS,
    ) -> None:
        statistics = read_prior() if statistics is None else statistics
        order = statistics.weights.argsort(descending=True)[:components]
        self._statistics = PatchPrior(
            statistics.level,
            statistics.weights[order] / statistics.weights[order].sum(),
            statistics.autocovariance[order],
        )
        self.frames = frames
        contrasts = contrasts if frames <= LONGEST_VIDEO else (1.0,)
        self._contrasts = torch.tensor(contrasts, dtype=torch.float64)
        self.weights = self._statistics.weights.double().repeat(len(contrasts)) / len(contrasts)
        self._factors: dict[int, PatchFactors] = {}

    def factors(self, block: int = BLOCK) -> PatchFactors:
        """Return the covariances of patches of mean 1, factored, for blocks of so many pixels a side."""
        if block not in self._factors:
            smooth = self.frames > LONGEST_VIDEO
            covariance = self._statistics.covariance(self.frames, block, *([0.0] if smooth else []))
            modes = (SMOOTH_MODES if smooth else MODES) * BLOCK**2
            factors = PatchFactors.of(covariance.double() / self._statistics.level**2, modes)
            self._factors[block] = factors.to(torch.float32)  # twice as fast, and precise enough; Cholesky's is not
        return self._factors[block]

    def at_every_contrast(self, covariance: torch.Tensor) -> torch.Tensor:
        """Return the covariances of all K, ``(K, ..)``, from those that :meth:`factors` gave for the components."""
        return (self._contrasts.view(-1, *[1] * covariance.ndim) * covariance).flatten(0, 1)

    def estimate_weights(self, log_likelihood: torch.Tensor) -> torch.Tensor:
        """Return the shares of the components, ``(K,)``, from the log-likelihoods ``(K, blocks)`` of blocks."""
        weights = self.weights
        for _ in range(ITERATIONS):
            shares = (log_likelihood + weights.log()[:, None]).softmax(0)
            weights = shares.sum(1) + PSEUDO_COUNT * self.weights
            weights = weights / weights.sum()
        return weights
