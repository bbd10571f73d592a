"""SCI3D (DUN-3DUnet): half-quadratic splitting, unfolded, with feature maps handed from U-net to U-net."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.convolution import Conv3d
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.decoder.layers.sequential import named_block
from sci_lightning.operator import SnapshotOperator

Maps = tuple[torch.Tensor, torch.Tensor, torch.Tensor]


def conv(inputs: int, outputs: int, stride: int = 1) -> Conv3d:
    """Return a 3x3x3 convolution that keeps T and divides H and W by ``stride``."""
    return Conv3d(inputs, outputs, 3, stride)


class ResidualPair(nn.Module):
    """``x + conv(ReLU(conv(x)))`` on features ``(N, C, T, H, W)``."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.convblock = nn.Sequential(conv(channels, channels), nn.ReLU(inplace=True), conv(channels, channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.convblock(x)


def down(inputs: int, outputs: int) -> nn.Sequential:
    """Return layers that halve H and W."""
    return named_block("convblock", conv(inputs, outputs, stride=2), nn.ReLU(inplace=True), ResidualPair(outputs))


def up(inputs: int, outputs: int) -> nn.Sequential:
    """Return layers that double H and W by repeating pixels."""
    return named_block(
        "convblock", ResidualPair(inputs), conv(inputs, outputs), up=nn.Upsample(scale_factor=(1.0, 2.0, 2.0))
    )


class Phase(nn.Module):
    """A data step with a learned eta and the 3-D U-net after it, which also gets the feature maps of the phase before.

    Args:
        channels: widths at full, half and quarter resolution.
        inner: channels of each of the two inputs after the first convolution, which is grouped.
        first: whether it is the first phase. Its generators of gates exist, as published, but are neither used nor
            trained.
    """

    plain_formulas = False

    def __init__(self, channels: Sequence[int], inner: int, first: bool) -> None:
        super().__init__()
        full, half, quarter = channels
        sources = 1 if first else 2
        self.eta_step = nn.Parameter(torch.full((1,), 0.01))
        self.inc = named_block(
            "convblock",
            nn.Conv3d(2, 2 * inner, 3, padding=1, groups=2),
            nn.ReLU(inplace=True),
            conv(2 * inner, full),
            nn.ReLU(inplace=True),
        )
        self.downc0 = down(full, half)
        self.downc1 = down(half, quarter)
        self.upc2 = up(sources * quarter, half)
        self.upc1 = up(sources * half, full)
        self.outc = named_block(
            "convblock", conv(sources * full, sources * full), nn.ReLU(inplace=True), conv(sources * full, 1)
        )
        self.generate_kernel1 = nn.Conv2d(1, 9 * quarter, 5, stride=4, padding=1, bias=False)
        self.generate_kernel2 = nn.Conv2d(1, 9 * half, 3, stride=2, padding=1, bias=False)
        self.generate_kernel3 = nn.Conv2d(1, 9 * full, 3, padding=1, bias=False)
        if first:
            for generator in (self.generate_kernel1, self.generate_kernel2, self.generate_kernel3):
                generator.requires_grad_(False)

    def forward(
        self,
        video: torch.Tensor,
        measurement: torch.Tensor,
        operator: SnapshotOperator,
        weight: torch.Tensor,
        guide: torch.Tensor,
        before: Maps | None,
    ) -> tuple[torch.Tensor, Maps]:
        """Return the improved video ``(N, T, H, W)`` and the feature maps for the next phase.

        Args:
            video: the estimate so far, ``(N, T, H, W)``.
            measurement: r, ``(N, H, W)``, which the data step makes the video explain.
            operator: A.
            weight: Q, ``(H, W)``.
            guide: y / Q, ``(N, 1, H, W)``.
            before: feature maps of the phase before at quarter, half and full resolution; None in the first phase.
        """
        old_quarter, old_half, old_full = before or (None, None, None)
        video = operator.data_step(video, measurement, weight + self.eta_step)
        inputs = torch.stack([video, guide.expand_as(video)], dim=1)
        full = self.inc(channels_last(inputs))
        half = self.downc0(full)
        quarter = self.downc1(half)
        up_half = self.upc2(self.join(quarter, old_quarter, self.generate_kernel1, guide))
        up_full = self.upc1(self.join(half + up_half, old_half, self.generate_kernel2, guide))
        change = self.outc(self.join(full + up_full, old_full, self.generate_kernel3, guide))
        return video + change[:, 0], (quarter, up_half, up_full)

    def join(
        self, features: torch.Tensor, old: torch.Tensor | None, generate: nn.Module, guide: torch.Tensor
    ) -> torch.Tensor:
        """Return features joined with the map of the phase before, if any, gated by kernels made from ``guide``."""
        if old is None:
            return features
        return torch.cat([features, gated(old, F.relu(generate(guide)), self.plain_formulas)], dim=1)


def gated(features: torch.Tensor, kernels: torch.Tensor, plain_formulas: bool) -> torch.Tensor:
    """Return features times the sigmoid of their product with 3 x 3 kernels that differ from pixel to pixel.

    Args:
        features: ``(N, C, T, H, W)``.
        kernels: ``(N, 9 C, H, W)``, the nine taps of a channel one after another; the same for all frames.
        plain_formulas: whether neighbourhoods are copied; else the products are summed in place without copies.
    """
    kernels = kernels.unflatten(1, (-1, 9)).unsqueeze(3)  # (N, C, 9, 1, H, W)
    padded = F.pad(features, (1, 1, 1, 1))
    if plain_formulas:
        neighbours = padded.unfold(-2, 3, 1).unfold(-2, 3, 1).flatten(-2)
        return features * torch.sigmoid((kernels.movedim(2, -1) * neighbours).sum(-1))
    height, width = features.shape[-2:]
    similarity = torch.zeros_like(features)
    for number, tap in enumerate(kernels.unbind(2)):
        row, column = divmod(number, 3)
        similarity.addcmul_(tap, padded[..., row : row + height, column : column + width])
    return features * torch.sigmoid(similarity)


class SCI3D(Decoder):
    """Phases of a data step and a U-net that also gets the features of the U-net before, for any T, H and W.

    From v = A^T y (as published) and r = 0, every phase computes r = r + y - A v, v = data step of v for the
    measurement r with weight Q + eta, and v = v + U-net(v, y / Q), where Q is the sum of M squared. The U-net hands its
    feature maps to the next one, which gates them with kernels made from y / Q. The loss sees v of every phase. H and W
    are padded to multiples of 4 inside.

    Args:
        phases: number of phases (10 as published).
        channels: widths at full, half and quarter resolution (32, 64, 128 as published).
        inner: channels of each of the two inputs after the first convolution (30 as published).
        first_estimate: see :class:`Decoder`.

    Parameters: 61,951,477 with the defaults, of which 36,577 are unused as published.
    Source: Wu, Zhang and Mou, "Dense deep unfolding network with 3D-CNN prior for snapshot compressive imaging",
    ICCV 2021.
    """

    multiple = 4

    def __init__(
        self,
        phases: Depth = 10,
        channels: Sequence[Width] = (32, 64, 128),
        inner: Depth = 30,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        self.receptive_field = 40 * phases
        self.Phi_scale = nn.Parameter(torch.full((1,), 0.01), requires_grad=False)  # unused, as published
        self.fcs = nn.ModuleList(Phase(channels, inner, first=number == 0) for number in range(phases))
        self.begin_at_first_video(*(phase.outc for phase in self.fcs if isinstance(phase, Phase)))

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        operator = self.operator(mask)
        weight = operator.sum_of_squares()
        guide = (measurement / weight).unsqueeze(1)
        video = self.first_video(operator.adjoint(measurement), measurement, mask).video
        residual = torch.zeros_like(measurement)
        maps: Maps | None = None
        estimates = []
        for phase in self.fcs:
            residual = residual + (measurement - operator(video))
            video, maps = phase(video, residual, operator, weight, guide, maps)
            estimates.append(video)
        return estimates
