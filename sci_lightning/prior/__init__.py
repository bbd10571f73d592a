"""Video in small patches with known statistics: the prior, the moments of a snapshot's blocks, and what follows.

A patch of B x B pixels and T frames has a mean and a covariance C. A snapshot of it behind the mask matrix A then has
mean A m and covariance A C A' + noise, from which follow the best linear estimate of the patch, the error that this
estimate is expected to make, and the likelihood of the snapshot when the scene is unknown.

The estimate itself is imported from ``estimator`` by those who need it: it imports torch's compiler, which takes
a second.
"""

from sci_lightning.prior.moments import BlockGrid, BlockMoments, PatchFactors, block_covariance
from sci_lightning.prior.prior import PatchPrior
from sci_lightning.prior.score import MaskScore, SensorNoise

__all__ = [
    "BlockGrid",
    "BlockMoments",
    "MaskScore",
    "PatchFactors",
    "PatchPrior",
    "SensorNoise",
    "block_covariance",
]
