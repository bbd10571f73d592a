"""FFDNet: a network for noise of any strength, which is one of its inputs."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.denoiser.denoiser import Denoiser, FixedNorm, keep_scale


class FFDNet(Denoiser):
    """A network that estimates the noise of every frame by itself, at half resolution.

    Every 2 x 2 pixels become four channels, beside a map of the strength. H and W are padded to multiples of 2 inside.

    Args:
        channels: width (64 as published).
        layers: number of 3 x 3 convolutions (15 as published).

    Parameters: 486,080 with the defaults.
    Source: Zhang, Zuo and Zhang, "FFDNet: toward a fast and flexible solution for CNN-based image denoising", IEEE
    Trans. Image Processing 2018, in the form of the public code cszn/FFDNet's port that PnP-SCI uses (grayscale).
    """

    alignment = 2
    published_names = ((r"net\.(.*)", r"intermediate_dncnn.itermediate_dncnn.\1"),)

    def __init__(self, channels: Width = 64, layers: Depth = 15) -> None:
        super().__init__()
        net: list[nn.Module] = [nn.Conv2d(5, channels, 3, padding=1, bias=False), nn.ReLU()]
        for _ in range(layers - 2):
            net += [nn.Conv2d(channels, channels, 3, padding=1, bias=False), FixedNorm(channels), nn.ReLU()]
        last = nn.Conv2d(channels, 4, 3, padding=1, bias=False)
        self.net = nn.Sequential(*net, last)
        self.receptive_field = 2 * layers + 1  # a pixel for every convolution, at half resolution
        keep_scale(self, last)

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        n, t, height, width = video.shape
        frames = video.reshape(n * t, 1, height, width)
        parts = F.pixel_unshuffle(F.pad(frames, (0, width % 2, 0, height % 2), mode="replicate"), 2)
        level = torch.full_like(parts[:, :1], strength)
        noise = F.pixel_shuffle(self.net(torch.cat([level, parts], 1)), 2)[..., :height, :width]
        return (frames - noise).view(n, t, height, width)
