"""ADMM-net: the alternating direction method of multipliers, unfolded, with a U-net as the prior of every stage."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Frames
from sci_lightning.decoder.gap_net import GAPNet
from sci_lightning.decoder.layers.unet import UNet


class ADMMNet(GAPNet):
    """ADMM unfolded into stages, each of a data step and a U-net of its own, as those of GAP-net.

    From theta = A^T y (as published) and b = 0, stage k computes x = data step of theta + b, theta = U-net(x - b) and
    b = b - (x - theta). A learned gamma_k, which starts from 0, is added to the weight of its data step. T is fixed at
    construction; H and W are free (padded to multiples of 4 inside). The loss sees theta of every stage.

    Args:
        frames: T.
        stages: number of stages (9 as published).
        others: see :class:`.GAPNet`; to the divisor of the data step, gamma_k is added.

    Parameters: 4,213,809 with the defaults at T = 8.
    Source: Ma, Liu, Shou and Yuan, "Deep tensor ADMM-Net for snapshot compressive imaging", ICCV 2019, in the form of
    the public code mengziyi64/ADMM-net.
    """

    def __init__(self, frames: Frames, stages: Depth = 9, **others: Any) -> None:
        super().__init__(frames, stages, **others)
        for stage in range(1, stages + 1):
            self.register_parameter(f"gamma{stage}", nn.Parameter(torch.zeros(1)))

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        operator = self.operator(mask)
        weight = operator.sum_of_squares() if self.squared else operator.total_or_one()
        theta = self.first_video(operator.adjoint(measurement), measurement, mask).video
        b = torch.zeros_like(theta)
        estimates: list[torch.Tensor] = []
        for unet, gamma in zip(self.children(), self.parameters(recurse=False), strict=True):
            x = operator.data_step(theta + b, measurement, weight + gamma)
            theta = self.locally(unet, UNet.receptive_field, x - b)
            b = b - (x - theta)
            estimates = self.with_estimate(estimates, theta)
        return estimates
