"""GAP: generalised alternating projection with any denoiser as the prior."""

from __future__ import annotations

import torch

from sci_lightning.decoder.iterative import Iterative, reused


class GAP(Iterative):
    """Accelerated generalised alternating projection, for any T, H and W.

    Every iteration projects x onto the videos that explain the measurement r, denoises the result, and adds the
    residual y - A x to r, which starts from the measurement y. This accumulation of residuals is what accelerates the
    method. With total variation as denoiser it is GAP-TV, with a network PnP-FFDNet or PnP-FastDVDnet. For the
    arguments see :class:`Iterative`.

    Source: Yuan, "Generalized alternating projection based total variation minimization for compressive sensing",
    ICIP 2016; Yuan, Liu, Suo and Dai, "Plug-and-play algorithms for large-scale snapshot compressive imaging", CVPR
    2020.
    """

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        weight = operator.sum_of_squares()
        video, accumulated = self.first_estimate(measurement, mask), measurement
        for iteration, strength in self.schedule():
            video = operator.data_step(video, accumulated, weight, out=reused(video))
            video = self.denoised(video, strength)
            residual = measurement - operator(video)
            if self.reached(residual, iteration):
                break
            accumulated = accumulated + residual
        return video
