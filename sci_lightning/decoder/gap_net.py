"""GAP-net: generalised alternating projection, unfolded, with a U-net as the prior of every stage."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.unet import UNet


class GAPNet(Decoder):
    """Generalised alternating projection unfolded into stages, each of a data step and a U-net of its own.

    From x = A^T y (as published), every stage computes x = U-net(data step of x). T is fixed at construction; H and W
    are free (padded to multiples of 4 inside). The loss sees the estimate of every stage.

    Args:
        frames: T.
        stages: number of stages (12 as published).
        channels: widths of the U-nets at full, half and quarter resolution (32, 64, 128 as published).
        squared: whether the data step divides by the sum of M squared, the exact projection; else by the sum of M, as
            published, which is the same for binary masks only.
        first_estimate: see :class:`Decoder`.

    Parameters: 5,618,400 with the defaults at T = 8.
    Source: Meng, Jalali and Yuan, "GAP-net for snapshot compressive imaging", 2020 (arXiv 2012.08364).
    """

    multiple = 4
    global_steps = True

    def __init__(
        self,
        frames: Frames,
        stages: Depth = 12,
        channels: Sequence[Width] = (32, 64, 128),
        squared: bool = True,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        self.frames = frames
        self.squared = squared
        for stage in range(1, stages + 1):
            self.add_module(f"unet{stage}", UNet(frames, channels))
        self.begin_at_first_video(*(unet.conv_last for unet in self.children() if isinstance(unet, UNet)))

    @property
    def halo(self) -> int:
        """Pixels around a tile that the network of a stage needs: there are no seams in between."""
        return UNet.receptive_field

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        operator = self.operator(mask)
        weight = operator.sum_of_squares() if self.squared else operator.total_or_one()
        video = self.first_video(operator.adjoint(measurement), measurement, mask).video
        estimates: list[torch.Tensor] = []
        for unet in self.children():
            video = self.locally(unet, UNet.receptive_field, operator.data_step(video, measurement, weight))
            estimates = self.with_estimate(estimates, video)
        return estimates
