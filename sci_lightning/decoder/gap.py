"""GAP: generalised alternating projection with any denoiser as the prior."""

from __future__ import annotations

import torch

from sci_lightning.decoder.iterative import Iterative


class GAP(Iterative):
    """Every iteration projects x onto the videos that explain r, denoises it, and adds y - sum of M x to r.

    r starts from the measurement y; adding what the denoised video leaves unexplained is what accelerates it. With
    total variation: GAP-TV; with a network: PnP-FFDNet, PnP-FastDVDnet. For its arguments see :class:`Iterative`.

    Source: Yuan, "Generalized alternating projection based total variation minimization for compressive sensing",
    ICIP 2016; Yuan, Liu, Suo and Dai, "Plug-and-play algorithms for large-scale snapshot compressive imaging", CVPR
    2020.
    """

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        weight = operator.sum_of_squares()
        video, accumulated = self.first_estimate(measurement, mask), measurement
        for iteration, strength in self.schedule():
            video = self.denoised(operator.data_step(video, accumulated, weight), strength)
            residual = measurement - operator(video)
            if self.reached(residual, iteration):
                break
            accumulated = accumulated + residual
        return video
