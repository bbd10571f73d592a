"""Which of two hypotheses snapshots prefer: nats that are calibrated by how much blocks and snapshots agree."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from scipy.stats import norm, wilcoxon
from scipy.stats import t as student

TILE = 2
"""Blocks along the side of a tile; blocks of one tile do not count as independent of each other."""
FEW_BLOCKS = 64
"""Of fewer blocks every one counts by itself: tiles would be too few to say anything."""
FEW = 3
"""Snapshots from which their differences are a measure of the uncertainty."""
BY_CHANCE = 0.05
"""Probability of the snapshots' signed ranks by chance below which the snapshots themselves ask for a hypothesis."""


@dataclass(frozen=True)
class Comparison:
    """How much likelier one hypothesis makes the snapshots than another one.

    Attributes:
        nats: difference of the log-likelihood as computed; the prior is only roughly right, so that it is not to be
            taken at face value.
        z: standard normal number that is exceeded as often by chance: Wilcoxon's signed ranks of the tiles.
        agree: how many snapshots prefer the first hypothesis.
        snapshots: of how many.
        p_snapshots: probability that chance alone makes the snapshots prefer the first hypothesis so clearly, by
            Wilcoxon's signed ranks of the snapshots themselves.
    """

    nats: float
    z: float
    agree: int
    snapshots: int
    p_snapshots: float = 1.0

    @property
    def calibrated(self) -> float:
        """Nats at which a right prior would have been as sure: a difference of d nats then has the variance 2 d."""
        return math.copysign(min(abs(self.nats), 2 * self.z**2), self.nats)

    @property
    def snapshots_ask(self) -> bool:
        """Whether the snapshots themselves ask for the first hypothesis.

        Three or four have to be unanimous; fewer do not tell.
        """
        by_chance = max(BY_CHANCE, 0.5**self.snapshots)
        return self.nats > 0 and self.snapshots >= FEW and self.p_snapshots <= by_chance

    @property
    def p_value(self) -> float:
        """Probability that chance alone prefers the first hypothesis so clearly, paired over tiles of blocks."""
        return float(norm.sf(self.z))


def compare(first: torch.Tensor, second: torch.Tensor, columns: int) -> Comparison:
    """Compare two hypotheses on the blocks that count for both.

    How much a tile gains differs by orders of magnitude between dark and bright, even and textured places. Ranks do
    not mind.

    Args:
        first, second: log-likelihoods ``(blocks, N)``, NaN where a block does not count.
        columns: of blocks.
    """
    difference = (first - second).nan_to_num(0.0)
    by_snapshot, by_tile = difference.sum(0), tiles(difference[None], columns)[0]
    by_tile = by_tile[by_tile != 0]
    z = 0.0
    if len(by_tile) >= 2:
        sides = [wilcoxon(by_tile.numpy(), alternative=side).pvalue for side in ("greater", "less")]
        z = float(norm.isf(max(sides[0], 1e-300)) if sides[0] < sides[1] else -norm.isf(max(sides[1], 1e-300)))
    asked = by_snapshot[by_snapshot != 0]
    by_chance = float(wilcoxon(asked.numpy(), alternative="greater").pvalue) if len(asked) else 1.0
    return Comparison(float(by_snapshot.sum()), z, int((asked > 0).sum()), len(asked), by_chance)


def tiles(scores: torch.Tensor, columns: int) -> torch.Tensor:
    """Return the sums of ``scores`` (p, blocks, N) over the blocks of every tile, ``(p, tiles * N)``."""
    grid = scores.reshape(len(scores), -1, columns, scores.shape[2])
    if grid[0].numel() < FEW_BLOCKS:
        return grid.flatten(1)
    down, across = (-(-side // TILE) * TILE for side in grid.shape[1:3])
    grid = torch.nn.functional.pad(grid, (0, 0, 0, across - grid.shape[2], 0, down - grid.shape[1]))
    return grid.unflatten(2, (-1, TILE)).unflatten(1, (-1, TILE)).sum((2, 4)).flatten(1)


def clustered(scores: torch.Tensor, columns: int) -> torch.Tensor:
    """Return the covariance ``(p, p)`` of the sums of ``scores`` (p, blocks, N) over blocks and snapshots.

    Tiles of blocks count as independent, and snapshots; of the two estimates the larger one (by its trace) is
    returned. Few snapshots say little about their differences, so that their estimate is enlarged by Student's factor.

    Source: White, "Maximum likelihood estimation of misspecified models", Econometrica 1982, for clusters.
    """
    best = _spread(tiles(scores, columns))
    sums = scores.sum(1)
    sums = sums[:, (sums != 0).any(0)]
    number = sums.shape[1]
    if number >= FEW:
        between = _spread(sums) * (student.ppf(0.975, number - 1) / 1.96) ** 2
        best = between if float(between.trace()) > float(best.trace()) else best
    elif number == 1:
        best = best * 4  # a single scene says nothing about how scenes differ
    return best


def _spread(values: torch.Tensor) -> torch.Tensor:
    """Return the covariance of the sum of independent values ``(p, n)``, from how they differ; zeros do not count."""
    values = values[:, (values != 0).any(0)]
    number = values.shape[1]
    centred = values - values.mean(1, keepdim=True) if number > 1 else values
    return centred @ centred.mT * (number / max(number - 1, 1))
