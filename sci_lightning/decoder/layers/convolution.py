"""Convolutions of video features ``(N, C, T, H, W)``: in space and time, and the two ways to double H and W.

That over time, height and width keeps T and is computed in the fastest of five ways. Each returns what
``torch.nn.functional.conv3d`` returns, to rounding. :func:`fastest_way` is the one place that chooses, by shape and
type. Its conditions were measured on CPUs, and ``python -m tests.studies.benchmark.convolutions`` measures them
again; on a GPU the vendor's library chooses for itself among algorithms for what the last three ways hand to it. In
bfloat16 that library's convolution over time runs at the speed of the processor, so that fewer multiplications in
float32 (Winograd) or work in blocks lose against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.layers.kernels import as_frames, as_video, channels_last, is_reduced
from sci_lightning.decoder.layers.winograd import winograd
from sci_lightning.full_precision import full_precision

FEWEST_WINOGRAD_CHANNELS = 32
"""Below this many inputs or outputs, transforming the tiles takes longer than the multiplications that it saves."""

MOST_STACKED_OUTPUTS = 16
"""So many outputs of a two-dimensional convolution, the float32 values of a vector register, cost as much as one."""

LARGEST_SMALL_COLUMN = 20480
"""Values of one column of pixels, N C T H, up to which torch keeps a convolution from its fast library."""


class Conv3d(nn.Conv3d):
    """``nn.Conv3d`` with zeros around the video, so that T stays, and H and W up to the stride.

    Args:
        channels: C, number of input channels.
        outputs: O, number of output channels; ``(N, C, T, H, W)`` becomes ``(N, O, T, H', W')``.
        kernel: number of taps along time, height and width, all odd; one number for all three.
        stride: 1, or 2 to halve height and width (rounded up).
    """

    plain_formulas = False
    bias: torch.Tensor

    def __init__(self, channels: int, outputs: int, kernel: int | tuple[int, int, int], stride: int = 1) -> None:
        sides = (kernel, kernel, kernel) if isinstance(kernel, int) else kernel
        padding = (sides[0] // 2, sides[1] // 2, sides[2] // 2)
        super().__init__(channels, outputs, sides, (1, stride, stride), padding)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x) if self.plain_formulas else convolution3d(x, self.weight, self.bias, self.stride[1])


class TransposedConv3d(nn.ConvTranspose3d):
    """Transposed 1 x 3 x 3 convolution that doubles H and W: ``(N, C, T, H, W)`` to ``(N, O, T, 2H, 2W)``."""

    plain_formulas = False

    def __init__(self, channels: int, outputs: int) -> None:
        super().__init__(channels, outputs, (1, 3, 3), (1, 2, 2), (0, 1, 1), (0, 1, 1))

    def forward(self, x: torch.Tensor, output_size: list[int] | None = None) -> torch.Tensor:
        if self.plain_formulas:
            return super().forward(x, output_size)
        frames = as_frames(channels_last(x))  # as a batch
        return as_video(F.conv_transpose2d(frames, self.weight.squeeze(2), self.bias, 2, 1, 1), len(x))


def pixel_shuffle(x: torch.Tensor) -> torch.Tensor:
    """Double H and W of every frame by pixel shuffle: ``(N, 4C, T, H, W)`` to ``(N, C, T, 2H, 2W)``."""
    return channels_last(as_video(F.pixel_shuffle(as_frames(x), 2), len(x)))


class LastConv2d(nn.Conv2d):
    """``nn.Conv2d`` in the precision of its weights, whatever ``torch.autocast`` says."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with full_precision():
            return super().forward(x.to(self.weight.dtype))


class LastConv3d(Conv3d):
    """``Conv3d`` of this package in the precision of its weights, whatever ``torch.autocast`` says."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        with full_precision():
            return super().forward(x.to(self.weight.dtype))


def convolution3d(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, stride: int) -> torch.Tensor:
    """Return the convolution ``(N, O, T, H', W')`` of x in channels-last layout, zeros around it.

    Args:
        x: ``(N, C, T, H, W)``, fastest in channels-last layout.
        weight: ``(O, C, taps, height, width)``, all odd.
        bias: ``(O,)``.
        stride: 1, or 2 to halve H and W (rounded up).
    """
    x = channels_last(x)
    return WAYS[fastest_way(x, weight, stride)](x, weight, bias, stride)


def fastest_way(x: torch.Tensor, weight: torch.Tensor, stride: int) -> str:
    """Return the name of the fastest of :data:`WAYS` for a convolution, whose arguments are those of the call."""
    if winograd_saves_time(x, weight, stride):
        return "winograd"
    if has_one_tap_in_time(weight):
        return "frames"
    if stacked_outputs_fit_a_register(weight):
        return "taps_as_outputs"
    if (is_small_for_torch(x, weight) and not is_reduced(x)) or has_more_taps_than_frames(x, weight):
        return "taps_as_inputs"
    return "vendor"


def winograd_saves_time(x: torch.Tensor, weight: torch.Tensor, stride: int) -> bool:
    """Return whether a convolution has 3 x 3 taps and enough channels; not on a GPU nor in mixed precision."""
    return (
        x.device.type == "cpu"
        and not is_reduced(x)
        and weight.shape[3:] == (3, 3)
        and stride == 1
        and min(weight.shape[:2]) >= FEWEST_WINOGRAD_CHANNELS
    )


def has_one_tap_in_time(weight: torch.Tensor) -> bool:
    """Return whether a convolution works on every frame by itself: then it is one of two dimensions."""
    return weight.shape[2] == 1


def stacked_outputs_fit_a_register(weight: torch.Tensor) -> bool:
    """Return whether the outputs of all taps along time are so few that together they cost as much as one tap's."""
    return weight.shape[2] * weight.shape[0] <= MOST_STACKED_OUTPUTS


def is_small_for_torch(x: torch.Tensor, weight: torch.Tensor) -> bool:
    """Return whether torch keeps this convolution of one snapshot from its fast library; a batch of frames gets it."""
    return len(x) == 1 and x[..., 0].numel() <= LARGEST_SMALL_COLUMN and max(weight.shape[2:]) <= 3


def has_more_taps_than_frames(x: torch.Tensor, weight: torch.Tensor) -> bool:
    """Return whether there are more taps than frames: then torch's gradient has NaN in it, in bfloat16 on a CPU."""
    return x.shape[2] < weight.shape[2]


def _taps_as_outputs(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, stride: int) -> torch.Tensor:
    """One two-dimensional convolution with an output for every tap along time; then the taps are shifted and summed."""
    taps, t = weight.shape[2], x.shape[2]
    parts = _of_frames(as_frames(x), weight.permute(2, 0, 1, 3, 4).flatten(0, 1), None, stride)
    parts = F.pad(as_video(parts, len(x)), (0, 0, 0, 0, taps // 2, taps // 2)).unflatten(1, (taps, -1))
    shifted = [parts[:, tap, :, tap : tap + t] for tap in range(taps)]
    return torch.stack(shifted).sum(0) + bias.view(-1, 1, 1, 1)


def _taps_as_inputs(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, stride: int) -> torch.Tensor:
    """One two-dimensional convolution of every frame with its neighbours in time as further channels."""
    taps, t = weight.shape[2], x.shape[2]
    padded = F.pad(x, (0, 0, 0, 0, taps // 2, taps // 2))
    neighbours = torch.cat([padded[:, :, tap : tap + t] for tap in range(taps)], dim=1)
    return as_video(_of_frames(as_frames(neighbours), weight.transpose(1, 2).flatten(1, 2), bias, stride), len(x))


def _frames(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, stride: int) -> torch.Tensor:
    """One two-dimensional convolution of every frame by itself."""
    return as_video(_of_frames(as_frames(x), weight.squeeze(2), bias, stride), len(x))


def _vendor(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, stride: int) -> torch.Tensor:
    """torch's convolution, which is that of the processor's or GPU's library."""
    rows, columns = weight.shape[3] // 2, weight.shape[4] // 2
    return F.conv3d(x, weight, bias, (1, stride, stride), (weight.shape[2] // 2, rows, columns))


def _of_frames(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None, stride: int) -> torch.Tensor:
    return F.conv2d(x, weight, bias, stride, (weight.shape[2] // 2, weight.shape[3] // 2))


WAYS: Mapping[str, Callable[[torch.Tensor, torch.Tensor, torch.Tensor, int], torch.Tensor]] = {
    "winograd": lambda x, weight, bias, stride: winograd(x, weight, bias),  # of stride 1 alone
    "frames": _frames,
    "taps_as_outputs": _taps_as_outputs,
    "taps_as_inputs": _taps_as_inputs,
    "vendor": _vendor,
}
"""Ways of computing a convolution, by name."""
