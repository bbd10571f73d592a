"""BIRNAT: a network for the first frame, then a forward and a backward recurrence for the other frames."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import torch
from torch import nn

from sci_lightning.configuration.bounds import Frames, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.convolution import LastConv2d
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.decoder.layers.sequential import leaky_relu_between, named_block
from sci_lightning.errors import BadInput

FEATURES_FIELD, FRAME_FIELD, STEP_FIELD = 46, 4, 22
"""Pixels over which inputs act on the features of the first frame before the attention, on that frame behind it, and on
a step of the recurrence."""
POSITION_WEIGHTS = 2**20
"""Weights between positions of the attention that exist at once, for every snapshot; all of them are (H W)^2."""


class ResidualPart(nn.Module):
    """Three residual steps ``x + conv3x3(LeakyReLU(conv1x1(LeakyReLU(conv3x3(x)))))`` on features ``(N, C, H, W)``."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        for step in (1, 2, 3):
            layers = leaky_relu_between(
                nn.Conv2d(channels, channels, 3, padding=1),
                nn.Conv2d(channels, channels, 1),
                nn.Conv2d(channels, channels, 3, padding=1),
            )
            self.add_module(f"conv{step}", layers)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        for layers in self.children():
            x = x + layers(x)
        return x


class PositionAttention(nn.Module):
    """Self-attention between all positions of features ``(N, C, H, W)``, added with a gain that starts from 0.

    As published, the softmax runs over the queries: the weights of one key for all queries add up to 1, while in
    ``scaled_dot_product_attention`` those of all keys for one query do.
    """

    plain_formulas = False

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gamma1 = nn.Parameter(torch.zeros(1))
        self.conv1 = nn.Conv2d(channels, channels // 8, 1)
        self.conv2 = nn.Conv2d(channels, channels // 8, 1)
        self.conv3 = nn.Conv2d(channels, channels, 1)
        self.conv4 = nn.Conv2d(channels, channels, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        queries, keys, values = (layer(x).flatten(2) for layer in (self.conv2, self.conv1, self.conv3))
        if self.plain_formulas:
            mixed = values @ torch.softmax(keys.mT @ queries, dim=-1)
        else:
            mixed = weighted_sum_of_positions(keys, queries, values)
        return x + self.gamma1 * self.conv4(mixed.view_as(x))


def weighted_sum_of_positions(keys: torch.Tensor, queries: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Return ``values @ softmax(keys^T @ queries)``, ``(N, C, P)``, without ever holding all P x P weights.

    Args:
        keys, queries: ``(N, D, P)`` at the P positions; the softmax runs over the queries.
        values: ``(N, C, P)``.
    """
    rows = max(1, POSITION_WEIGHTS // keys.shape[2])
    total = torch.zeros_like(values)
    for block, part in zip(keys.split(rows, -1), values.split(rows, -1), strict=True):
        total = torch.baddbmm(total, part, torch.softmax(block.transpose(1, 2) @ queries, dim=-1))
    return total


class FirstFrame(nn.Sequential):
    """The network from [m, M * m], ``(N, 1 + T, H, W)``, to the first frame ``(N, 1, H, W)``, with published names."""

    def __init__(self, inputs: int, channels: int) -> None:
        half, quarter, eighth = channels // 2, channels // 4, channels // 8
        layers = OrderedDict(
            conv1=nn.Conv2d(inputs, quarter, 5, padding=2),
            relu1=nn.LeakyReLU(inplace=True),
            conv2=nn.Conv2d(quarter, half, 3, padding=1),
            relu2=nn.LeakyReLU(inplace=True),
            conv3=nn.Conv2d(half, half, 1),
            relu3=nn.LeakyReLU(inplace=True),
            conv4=nn.Conv2d(half, channels, 3, stride=2, padding=1),
            relu4=nn.LeakyReLU(inplace=True),
            res_part1=ResidualPart(channels),
            conv7=nn.Conv2d(channels, channels, 3, padding=1),
            relu7=nn.LeakyReLU(inplace=True),
            conv8=nn.Conv2d(channels, channels, 1),
            res_part2=ResidualPart(channels),
            conv9=nn.Conv2d(channels, channels, 3, padding=1),
            relu9=nn.LeakyReLU(inplace=True),
            conv10=nn.Conv2d(channels, channels, 1),
            res_part3=ResidualPart(channels),
            att1=PositionAttention(channels),
            conv5=nn.ConvTranspose2d(channels, half, 3, stride=2, padding=1, output_padding=1),
            relu5=nn.LeakyReLU(inplace=True),
            conv51=nn.Conv2d(half, quarter, 3, padding=1),
            relu51=nn.LeakyReLU(inplace=True),
            conv52=nn.Conv2d(quarter, eighth, 1),
            relu52=nn.LeakyReLU(inplace=True),
            conv6=LastConv2d(eighth, 1, 3, padding=1),
        )
        super().__init__(layers)

    def by_parts(self, x: torch.Tensor, locally: Callable[..., torch.Tensor]) -> torch.Tensor:
        """Return the result for ``(N, 1 + T, H, W)``; ``locally`` computes what is before and behind the attention."""
        layers = list(self.children())
        attention = list(self._modules).index("att1")
        before, behind = nn.Sequential(*layers[:attention]), nn.Sequential(*layers[attention + 1 :])
        features = locally(lambda part: before(channels_last(part)), FEATURES_FIELD, x)
        return locally(behind, FRAME_FIELD, layers[attention](features), reduced=2)


class Recurrence(nn.Module):
    """A recurrence from the first frame over all later slots.

    Args:
        hidden: width of the state and of the features of the frame before; the measurement's have half of it.

    Convolutions that follow each other without an activation are as published.
    """

    def __init__(self, hidden: int) -> None:
        super().__init__()
        half = hidden // 2
        width = 5 * half
        self.extract_feature1 = named_block(
            "conv",
            nn.Conv2d(1, hidden, 5, padding=2),
            nn.Conv2d(hidden, hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(hidden, hidden, 3, padding=1),
            nn.Conv2d(hidden, 2 * hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(2 * hidden, hidden, 3, padding=1),
        )
        self.up_feature1 = named_block(
            "conv",
            nn.Conv2d(width, 2 * hidden, 3, padding=1),
            nn.Conv2d(2 * hidden, 3 * half, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(3 * half, hidden, 3, padding=1),
            nn.Conv2d(hidden, hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(hidden, hidden, 3, padding=1),
            LastConv2d(hidden, 1, 1),
        )
        self.conv_x = nn.Sequential(
            nn.Conv2d(2, hidden, 5, padding=2),
            nn.Conv2d(hidden, hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(hidden, 4 * hidden, 3, stride=2, padding=1),
            nn.Conv2d(4 * hidden, 2 * hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(2 * hidden, 2 * hidden, 3, padding=1),
            nn.LeakyReLU(inplace=True),
            nn.ConvTranspose2d(2 * hidden, half, 3, stride=2, padding=1, output_padding=1),
        )
        self.h_h = nn.Sequential(
            nn.Conv2d(width, 3 * half, 3, padding=1),
            nn.Conv2d(3 * half, hidden, 1),
            nn.LeakyReLU(inplace=True),
            nn.Conv2d(hidden, hidden, 3, padding=1),
        )
        self.res_part1 = ResidualPart(width)
        self.res_part2 = ResidualPart(width)

    def step(self, frame: torch.Tensor, state: torch.Tensor, measured: torch.Tensor) -> torch.Tensor:
        """Return the next frame and the next state, one behind the other, ``(N, 1 + hidden, H, W)``.

        Args:
            frame: estimate of the slot before, ``(N, 1, H, W)``.
            state: ``(N, hidden, H, W)``.
            measured: the mean frame and the part of the measurement that belongs to the slot, ``(N, 2, H, W)``.
        """
        features = torch.cat([state, self.conv_x(channels_last(measured)), self.extract_feature1(frame)], dim=1)
        features = self.res_part2(self.res_part1(channels_last(features)))
        return torch.cat([self.up_feature1(features), self.h_h(features)], dim=1)

    def forward(
        self,
        frame: torch.Tensor,
        state: torch.Tensor,
        measurement: torch.Tensor,
        mean: torch.Tensor,
        mask: torch.Tensor,
        locally: Callable[..., torch.Tensor],
        known: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the video ``(N, T, H, W)`` in the mask's order of slots, and the last state.

        Args:
            frame: estimate of the first slot, ``(N, 1, H, W)``.
            state: ``(N, hidden, H, W)``.
            measurement, mean: y and y / sum of M, ``(N, H, W)``.
            mask: ``(T, H, W)``.
            locally: how a step is computed, see :meth:`~sci_lightning.decoder.decoder.Decoder.locally`.
            known: the video ``(N, T, H, W)`` to whose frames the recurrence adds; None if its frames stand for
                themselves.
        """
        frames = [frame]
        unexplained = measurement
        for slot in range(1, len(mask)):
            # The part of the measurement that belongs to this slot: estimated frames are subtracted from it, and for
            # the frames to come the mean frame is subtracted.
            unexplained = unexplained - mask[slot - 1] * frame[:, 0]
            share = unexplained - mask[slot + 1 :].sum(0) * mean
            following = locally(self.step, STEP_FIELD, frame, state, torch.stack([mean, share], dim=1))
            frame, state = following[:, :1], following[:, 1:]
            if known is not None:
                frame = frame + known[:, slot : slot + 1]
            frames.append(frame)
        return torch.cat(frames, dim=1), state


class BIRNAT(Decoder):
    """A network with attention between all positions for the first frame, and two recurrences for the others.

    The forward recurrence runs from the first frame to the last; the backward one, with weights of its own, starts from
    that last frame and the state of the forward one, and runs to the first. The loss sees both videos; the backward one
    is the estimate. T is fixed at construction; H and W are free (padded to multiples of 2 inside). The cost of the
    attention grows with the square of the number of pixels.

    Args:
        frames: T.
        channels: width of the first-frame network at half resolution, a multiple of 8 (128 as published).
        hidden: width of the recurrent state, even (20 as published).
        first_estimate: see :class:`Decoder`.

    Raises:
        BadInput: channels is no multiple of 8, or hidden is odd.

    Parameters: 4,131,640 with the defaults at T = 8.
    Source: Cheng, Lu, Wang, Zhang, Chen, Meng and Yuan, "BIRNAT: bidirectional recurrent neural networks with
    adversarial training for video snapshot compressive imaging", ECCV 2020.
    """

    multiple = 2
    global_steps = True

    def __init__(
        self, frames: Frames, channels: Width = 128, hidden: Width = 20, first_estimate: FirstEstimate = "published"
    ) -> None:
        super().__init__(first_estimate)
        if channels % 8 or hidden % 2:
            raise BadInput(f"BIRNAT: channels={channels} must be a multiple of 8 and hidden={hidden} of 2")
        self.frames = frames
        self.hidden = hidden
        self.first_frame_net = FirstFrame(1 + frames, channels)
        self.forward_rnn = Recurrence(hidden)
        self.backrnn = Recurrence(hidden)
        self.begin_at_first_video(self.first_frame_net, self.forward_rnn.up_feature1, self.backrnn.up_feature1)

    @property
    def halo(self) -> int:
        """Pixels around a tile that any of the steps needs."""
        return max(FEATURES_FIELD, FRAME_FIELD, STEP_FIELD)

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        operator = self.operator(mask)
        mean = operator.mean_frame(measurement)
        modulated = operator.adjoint(mean)
        given = self.first_video(modulated, measurement, mask)
        known = given.video if given.improved else None
        first = self.first_frame_net.by_parts(torch.cat([mean.unsqueeze(1), given.video], dim=1), self.locally)
        first = first if known is None else first + known[:, :1]
        state = modulated.new_zeros(len(modulated), self.hidden, *mask.shape[1:])
        there, state = self.forward_rnn(first, state, measurement, mean, mask, self.locally, known)
        known = None if known is None else known.flip(1)
        back, _ = self.backrnn(there[:, -1:], state, measurement, mean, mask.flip(0), self.locally, known)
        return self.with_estimate([there], back.flip(1))
