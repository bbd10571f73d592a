"""The best linear estimate in closed form: no training and no iteration, only second moments of video."""

from __future__ import annotations

from pathlib import Path

import torch

from sci_lightning.configuration.bounds import Pixels, Positive
from sci_lightning.decoder.decoder import Decoder


class Linear(Decoder):
    r"""The best linear estimate of every block of the video, for any mask, binary or gray, any T, H and W.

    For a block with the mask matrix A and patches of mean m and covariance C the estimate is

    .. math:: \hat x = m + C A^\top (A C A^\top + \sigma^2)^{-1} (y - A m) .

    Overlapping blocks are averaged. Of a mixture of Gaussians, every block takes the most likely one. The matrices of
    a mask are computed at the first measurement and kept, see
    :class:`~sci_lightning.prior.estimator.LinearEstimator`, which also has the arguments and what they raise.

    Source: Yang et al., "Video compressive sensing using Gaussian mixture models", IEEE Trans. Image Processing 2014.
    """

    global_steps = True  # in strips of its own

    def __init__(
        self,
        noise: Positive = 0.02,
        block: Pixels = 8,
        stride: Pixels = 4,
        mixture: bool = True,
        prior: str | Path | None = None,
    ) -> None:
        from sci_lightning.prior.estimator import LinearEstimator

        super().__init__()
        self.estimator = LinearEstimator(noise, block, stride, mixture, prior)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        self.estimator.watch = self.watch
        return self.estimator(measurement, mask)

    def kept_bytes(self, height: int, width: int) -> int:
        return self.estimator.kept_bytes(height, width)
