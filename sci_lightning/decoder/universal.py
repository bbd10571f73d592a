"""Universal: an unrolled network that begins at GAP-TV's estimate and decodes behind masks that it has never seen."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Frames, Width
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.layers.kernels import channels_last

GAMMA = 0.01
"""Added to divisors, so that pixels of little light do not multiply noise."""


class Block(nn.Module):
    """``x + conv(ReLU(conv(x)))`` with 3 x 3 convolutions, on features ``(N, C, H, W)``; the identity to begin with."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)
        for parameter in self.second.parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.second(F.relu(self.first(x)))


class Body(nn.Module):
    """A U-net of three levels on features ``(N, C, H, W)``; H and W are multiples of 4.

    Args:
        widths: C at full, half and quarter resolution.
        blocks: residual blocks on each side of a level.
    """

    def __init__(self, widths: Sequence[int], blocks: int) -> None:
        super().__init__()
        self.blocks = blocks
        full, half, quarter = widths

        def several(channels: int) -> nn.Module:
            return nn.Sequential(*(Block(channels) for _ in range(blocks)))

        self.encode1, self.down1 = several(full), nn.Conv2d(full, half, 2, stride=2)
        self.encode2, self.down2 = several(half), nn.Conv2d(half, quarter, 2, stride=2)
        self.middle, self.up2 = several(quarter), nn.ConvTranspose2d(quarter, half, 2, stride=2)
        self.decode2, self.up1 = several(half), nn.ConvTranspose2d(half, full, 2, stride=2)
        self.decode1 = several(full)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        skip1 = self.encode1(x)
        skip2 = self.encode2(self.down1(skip1))
        deep = self.decode2(skip2 + self.up2(self.middle(self.down2(skip2))))
        return self.decode1(skip1 + self.up1(deep))


class Universal(Decoder):
    r"""An iterative decoder's estimate, corrected a few times by one small network that sees the mask.

    Pass k takes a data step of learned length s_k, moves on along the steps before by m_k, as the acceleration of
    :class:`.GAP` does, and adds what the network says of it:

    .. math::
        v = x_k + s_k r_k + m_k \sum_{j < k} r_j, \quad x_{k+1} = v + N_k(v, r_k, M, \bar y), \quad
        r_k = A^\top \frac{y - A x_k}{R + \gamma}, \quad \bar y = \frac{y}{\sum_t M_t + \gamma}.

    N_k is a U-net at half resolution, 2 x 2 pixels as channels, whose first and last convolution belong to the pass and
    whose body is the same for all. As the network sees the mask of every snapshot, it can be trained behind many masks
    at once. It takes the frames of a window as channels; of a video with more, it corrects windows of neighbouring
    frames that overlap where they must, and means are taken; of one with fewer, the last frame is repeated.

    Args:
        start: the decoder whose estimate is corrected.
        window: frames that the network takes.
        passes: how often it corrects, K.
        widths: channels of its three levels.
        blocks: residual blocks on each side of a level.

    Parameters: 1,227,400 with the defaults.
    Source: the data step with gamma is that of half-quadratic splitting, see :meth:`.SnapshotOperator.data_step`; the
    network and its training are this project's own.
    """

    global_steps = True
    multiple = 8

    def __init__(
        self,
        start: Decoder,
        window: Frames = 8,
        passes: Depth = 4,
        widths: Sequence[Width] = (64, 96, 128),
        blocks: Depth = 1,
    ) -> None:
        super().__init__()
        self.start = start
        self.window = window
        inputs, outputs = 4 * (3 * window + 1), 4 * window
        self.heads = nn.ModuleList(nn.Conv2d(inputs, widths[0], 3, padding=1) for _ in range(passes))
        self.tails = nn.ModuleList(nn.Conv2d(widths[0], outputs, 3, padding=1) for _ in range(passes))
        self.body = Body(widths, blocks)
        self.step = nn.Parameter(torch.zeros(passes))
        self.momentum = nn.Parameter(torch.zeros(passes))
        for parameter in self.tails.parameters():
            nn.init.zeros_(parameter)

    @property
    def halo(self) -> int:
        """Pixels around a tile that act on a correction: only the network works tile by tile, beside the start."""
        return 8 * (5 * self.body.blocks + 1)

    def first_estimate(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimate ``(N, T, H, W)`` that is corrected; it is never trained."""
        self.start.watch = self.watch
        with torch.no_grad():
            if self._tiling is None:
                return self.start(measurement, mask)
            return self.start.in_tiles(measurement, mask, self._tiling)

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        return self.corrected(measurement, mask, self.first_estimate(measurement, mask))

    def corrected(self, measurement: torch.Tensor, mask: torch.Tensor, video: torch.Tensor) -> list[torch.Tensor]:
        """Return the estimates after every pass.

        Args:
            measurement: y, ``(N, H, W)``, the sum over t of M_t x_t.
            mask: M, ``(T, H, W)``, or of every snapshot, ``(N, T, H, W)``.
            video: the estimate to begin with, ``(N, T, H, W)``.
        """
        mask = mask.expand(len(measurement), -1, -1, -1)
        weight = mask.square().sum(1) + GAMMA
        mean = (measurement / (mask.sum(1) + GAMMA)).unsqueeze(1)
        estimates: list[torch.Tensor] = []
        earlier = torch.zeros_like(video)
        for number, (step, momentum) in enumerate(zip(self.step, self.momentum, strict=True)):
            residual = mask * ((measurement - (mask * video).sum(1)) / weight).unsqueeze(1)
            video = video + step * residual + momentum * earlier
            earlier = earlier + residual
            correct = partial(self._correction, number)
            video = video + self.locally(correct, self.halo, video, residual, mask, mean)
            estimates = self.with_estimate(estimates, video)
        return estimates

    def _correction(
        self, number: int, video: torch.Tensor, residual: torch.Tensor, mask: torch.Tensor, mean: torch.Tensor
    ) -> torch.Tensor:
        """Return what pass ``number`` adds to the video: the mean over the windows that contain a frame."""
        frames = video.shape[1]
        count = -(-frames // self.window)
        starts = [round(k * (frames - self.window) / max(1, count - 1)) for k in range(count)]
        total, covered = torch.zeros_like(video), video.new_zeros(frames)
        for first in starts if frames > self.window else [0]:
            inside = torch.arange(first, first + self.window, device=video.device).clamp(max=frames - 1)
            seen = (video[:, inside], residual[:, inside], mask[:, inside] - 0.5, mean)
            features = channels_last(F.pixel_unshuffle(torch.cat(seen, 1), 2))
            correction = F.pixel_shuffle(self.tails[number](self.body(self.heads[number](features))), 2)
            last = min(first + self.window, frames)
            total[:, first:last] += correction[:, : last - first]
            covered[first:last] += 1
        return total / covered[:, None, None]
