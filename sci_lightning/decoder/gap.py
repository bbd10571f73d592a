"""GAP: generalised alternating projection with any denoiser as the prior."""

from __future__ import annotations

import torch

from sci_lightning.decoder.iterative import Iterative
from sci_lightning.decoder.layers.data_step import data_step, snapshot
from sci_lightning.decoder.layers.initial_estimate import mask_total


class GAP(Iterative):
    """Every iteration projects x onto the videos that explain r, denoises it, and adds y - sum of M x to r.

    r starts from the measurement y; adding what the denoised video leaves unexplained is what accelerates it. With
    total variation: GAP-TV; with a network: PnP-FFDNet, PnP-FastDVDnet. For its arguments see :class:`Iterative`.

    Source: Yuan, "Generalized alternating projection based total variation minimization for compressive sensing",
    ICIP 2016; Yuan, Liu, Suo and Dai, "Plug-and-play algorithms for large-scale snapshot compressive imaging", CVPR
    2020.
    """

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        weight = mask_total(mask, squared=True)
        video, asked = self.first_estimate(measurement, mask), measurement
        for iteration, strength in self.schedule():
            video = self.denoised(data_step(video, asked, mask, weight), strength)
            residual = measurement - snapshot(video, mask)
            if self.reached(residual, iteration):
                break
            asked = asked + residual
        return video
