"""ELP-Unfolding: an augmented Lagrangian method, unfolded, first with one prior and then with ensembles of priors."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.sequential import named_block
from sci_lightning.errors import BadInput

Features = list[torch.Tensor]


def conv(inputs: int, outputs: int, stride: int = 1) -> nn.Conv2d:
    """Return a 3 x 3 convolution without bias that divides H and W by ``stride``."""
    return nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False)


def pair(inputs: int, inner: int, outputs: int) -> nn.Sequential:
    """Return two 3 x 3 convolutions, each with a ReLU behind it."""
    return named_block(
        "convblock", conv(inputs, inner), nn.ReLU(inplace=True), conv(inner, outputs), nn.ReLU(inplace=True)
    )


def down(inputs: int, outputs: int) -> nn.Sequential:
    """Return layers that halve H and W."""
    return named_block(
        "convblock", conv(inputs, outputs, stride=2), nn.ReLU(inplace=True), pair(outputs, outputs, outputs)
    )


def up(inputs: int, outputs: int) -> nn.Sequential:
    """Return layers that double H and W by pixel shuffle."""
    return named_block("convblock", pair(inputs, inputs, inputs), conv(inputs, 4 * outputs), nn.PixelShuffle(2))


class UNet(nn.Module):
    """The prior's network, which also gets the features of all networks before it; video ``(N, T, H, W)`` to the same.

    Each of its five feature maps is joined with the sum of this map over all networks before.

    Args:
        frames: T.
        channels: C, width at quarter resolution; C/2 at half, C/4 at full.
        first: whether there is no network before.
    """

    def __init__(self, frames: int, channels: int, first: bool) -> None:
        super().__init__()
        full, half, sources = channels // 4, channels // 2, 1 if first else 2
        self.inc = pair(frames + 2, channels, full)
        self.downc0 = down(sources * full, half)
        self.downc1 = down(sources * half, channels)
        self.upc2 = up(sources * channels, half)
        self.upc1 = up(sources * half, full)
        self.outc = named_block(
            "convblock", conv(sources * full, sources * full), nn.ReLU(inplace=True), conv(sources * full, frames)
        )

    def forward(
        self, video: torch.Tensor, gamma2: torch.Tensor, mean: torch.Tensor, before: Features
    ) -> tuple[torch.Tensor, Features]:
        """Return the improved video, and the sums of feature maps including those of this network.

        Args:
            video: the estimate so far, ``(N, T, H, W)``.
            gamma2: one value, which the network gets as a constant map.
            mean: y / sum of M, ``(N, 1, H, W)``.
            before: sums of features over the networks before; empty for the first.
        """
        inputs = torch.cat([video, gamma2.expand_as(mean), mean], dim=1)
        full = self.inc(inputs)  # not channels-last: a CPU would reorder these many weights in every call
        half = self.downc0(torch.cat([full, *before[0:1]], dim=1))
        quarter = self.downc1(torch.cat([half, *before[1:2]], dim=1))
        up_half = self.upc2(torch.cat([quarter, *before[2:3]], dim=1))
        up_full = self.upc1(torch.cat([up_half + half, *before[3:4]], dim=1))
        change = self.outc(torch.cat([up_full + full, *before[4:5]], dim=1))
        features = [full, half, quarter, up_half, up_full]
        if before:
            features = [new + old for new, old in zip(features, before, strict=True)]
        return video + change, features


class Iteration(nn.Module):
    """A network with its penalty weights, gamma1 for the measurement and gamma2 for the prior."""

    def __init__(self, frames: int, channels: int, first: bool) -> None:
        super().__init__()
        self.gamma1 = nn.Parameter(torch.ones(1))
        self.gamma2 = nn.Parameter(torch.ones(1))
        self.visualtransformer = UNet(frames, channels, first)


class ELPUnfolding(Decoder):
    """Eight iterations with one prior, then five with ensembles of priors: 13 networks.

    With the multipliers l1 (of the measurement) and l2 (of the prior), both from 0, and v from ones (as published),
    every iteration computes v = U-net(x - l2 / gamma2), l1 = l1 - gamma1 (y - A x), l2 = l2 - gamma2 (x - v), and then
    x = data step of (sum of (l2 + gamma2 v) - A^T l1) / G with weight R + G / gamma1. Here G = sum of gamma2, and both
    sums run over the priors of the ensemble. An ensemble of n priors consists of the newest and of the first n - 1,
    which keep their v, l2 and gamma2; the newest starts from the l2 of the one before it, and gamma1 stays that of the
    eighth iteration. The loss sees x of every iteration. T is fixed at construction; H and W are free (padded to
    multiples of 4 inside).

    Args:
        frames: T.
        channels: C, width at quarter resolution, a multiple of 4 (512 as published).
        iterations: number of iterations with the first prior (8 as published).
        priors: one more than the number of ensembles (6 as published).
        squared: whether R is the sum of M squared, the exact minimiser, as the authors have it; else the sum of M, as
            in the cacti toolbox, which is the same for binary masks only.
        first_estimate: see :class:`Decoder`.

    Raises:
        BadInput: the width is no multiple of 4.

    Parameters: 565,733,402 with the defaults at T = 8, of which 5 are unused as published.
    Source: Yang, Zhang and Yuan, "Ensemble learning priors driven deep unfolding for scalable video snapshot
    compressive imaging", ECCV 2022.
    """

    multiple = 4

    def __init__(
        self,
        frames: Frames,
        channels: Width = 512,
        iterations: Depth = 8,
        priors: Depth = 6,
        squared: bool = True,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        if channels % 4:
            raise BadInput(f"ELP-Unfolding: channels={channels} must be a multiple of 4")
        self.frames = frames
        self.squared = squared
        self.receptive_field = 40 * (iterations + priors - 1)
        alone = [Iteration(frames, channels, first=number == 0) for number in range(iterations)]
        ensembles = [Iteration(frames, channels, first=False) for _ in range(1, priors)]
        for iteration in ensembles:
            iteration.gamma1.requires_grad_(False)
        self.all = nn.ModuleList(
            nn.ModuleDict({"AL": nn.ModuleList(newest)})
            for newest in (alone, *([iteration] for iteration in ensembles))
        )
        networks = (part.outc for part in self.all.modules() if isinstance(part, UNet))
        self.begin_at_first_video(*networks)

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        operator = self.operator(mask)
        weight = operator.sum_of_squares() if self.squared else operator.total_or_one()
        mean = operator.mean_frame(measurement).unsqueeze(1)
        priors = [[part for part in prior.modules() if isinstance(part, Iteration)] for prior in self.all]
        ones = torch.ones_like(mask).expand(len(measurement), -1, -1, -1)
        first = self.first_video(ones, measurement, mask).video
        x = operator.data_step(first, measurement, weight + priors[0][0].gamma2 / priors[0][0].gamma1)
        l1, l2 = torch.zeros_like(measurement), torch.zeros_like(x)
        features: Features = []
        kept: list[tuple[torch.Tensor, torch.Tensor]] = []  # (gamma2, l2 + gamma2 v) of every finished prior
        estimates = []
        for iterations in priors:
            for iteration in iterations:
                gamma1 = iteration.gamma1 if iterations is priors[0] else priors[0][-1].gamma1
                gamma2 = iteration.gamma2
                v, features = iteration.visualtransformer(x - l2 / gamma2, gamma2, mean, features)
                l1 = l1 - gamma1 * (measurement - operator(x))
                l2 = l2 - gamma2 * (x - v)
                newest = (gamma2, l2 + gamma2 * v)
                gammas, targets = zip(*kept[:-1], newest, strict=True)
                total = sum(gammas)
                x = (sum(targets) - operator.adjoint(l1)) / total
                x = operator.data_step(x, measurement, weight + total / gamma1)
                estimates.append(x)
            kept.append(newest)
        return estimates
