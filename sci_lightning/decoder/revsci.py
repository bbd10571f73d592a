"""RevSCI: three-dimensional convolutions in reversible blocks, which can train without storing activations."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from sci_lightning.configuration.bounds import Depth, Width
from sci_lightning.decoder.decoder import Decoder, FirstEstimate
from sci_lightning.decoder.layers.convolution import Conv3d, LastConv3d, TransposedConv3d
from sci_lightning.decoder.layers.kernels import as_one_channel, is_reduced
from sci_lightning.decoder.layers.sequential import leaky_relu_after_all, leaky_relu_between


class ReversibleBlock(nn.Module):
    """A block whose input can be computed from its output: y1 = x1 + f(x2), y2 = x2 + g(y1).

    Both halves of the channels are ``(N, C, T, H, W)``; back it goes by x2 = y2 - g(y1), x1 = y1 - f(x2). The sums are
    computed in the precision of the halves, f and g in that of their weights.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.f1, self.g1 = (
            leaky_relu_between(Conv3d(channels, channels, 3), Conv3d(channels, channels, 3)) for _ in range(2)
        )

    def forward(self, x1: torch.Tensor, x2: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        y1 = x1 + self.f1(x2.to(precision(self.f1)))
        return y1, x2 + self.g1(y1.to(precision(self.g1)))


def precision(module: nn.Module) -> torch.dtype:
    """Return the floating-point type of a module's weights."""
    return next(module.parameters()).dtype


class Reversed(torch.autograd.Function):
    """A sequence of reversible blocks that stores its result only; the backward pass computes all inputs from it.

    Source: Gomez, Ren, Urtasun and Grosse, "The reversible residual network", NeurIPS 2017.
    """

    @staticmethod
    def forward(
        ctx: Any, blocks: nn.ModuleList, x1: torch.Tensor, x2: torch.Tensor, *parameters: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Compute the blocks; ``parameters`` are theirs, in their order, so that torch computes gradients for them."""
        device = x1.device.type
        ctx.blocks = blocks
        ctx.precision = device, torch.get_autocast_dtype(device), torch.is_autocast_enabled(device)
        for block in blocks:
            x1, x2 = block(x1, x2)
        ctx.save_for_backward(x1, x2)
        return x1, x2

    @staticmethod
    def backward(ctx: Any, d1: torch.Tensor, d2: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        y1, y2 = ctx.saved_tensors
        gradients: list[torch.Tensor] = []
        with torch.autocast(*ctx.precision):
            for block in reversed(ctx.blocks):
                # Recompute the input of one half from the other; d1 and d2 are the gradients of the two sums.
                x2, into_y1, of_g = _undo(block.g1, y1, y2, d2)
                d1 = d1 + into_y1
                x1, into_x2, of_f = _undo(block.f1, x2, y1, d1)
                d2 = d2 + into_x2
                y1, y2 = x1, x2
                gradients = [*of_f, *of_g, *gradients]
        return None, d1, d2, *gradients


@torch.enable_grad()
def _undo(
    function: nn.Module, x: torch.Tensor, total: torch.Tensor, gradient: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, tuple[torch.Tensor, ...]]:
    """Return z of total = z + function(x), and the gradients with respect to x and to the function's parameters."""
    x = x.to(precision(function)).detach().requires_grad_()
    value = function(x)
    into_x, *of_parameters = torch.autograd.grad(value, [x, *function.parameters()], gradient.to(value.dtype))
    return total - value.detach(), into_x, tuple(of_parameters)


class RevSCI(Decoder):
    """A sequence of reversible blocks at half resolution, for any T, H and W (padded to multiples of 2 inside).

    The input as published is m + M * m, where m = y / sum of M.

    Args:
        blocks: reversible blocks (50 as published).
        channels: width C of the blocks, a multiple of 4 (64 as published).
        reversible: whether to train without storing the activations of the blocks. They are computed again in the
            backward pass, which takes about a third more time; the gradients are the same to rounding.
        first_estimate: see :class:`Decoder`.

    Parameters: 5,655,393 with the defaults.
    Source: Cheng, Chen, Liu, Zhang, Liu, Huang, Chen and Yuan, "Memory-efficient network for large-scale video
    compressive sensing", CVPR 2021.
    """

    multiple = 2

    def __init__(
        self,
        blocks: Depth = 50,
        channels: Width = 64,
        reversible: bool = False,
        first_estimate: FirstEstimate = "published",
    ) -> None:
        super().__init__(first_estimate)
        self.reversible = reversible
        half, quarter = channels // 2, channels // 4
        self.receptive_field = 8 * blocks + 7  # four convolutions in every block, at half resolution
        self.conv1 = leaky_relu_after_all(
            Conv3d(1, quarter, 5), Conv3d(quarter, half, 3), Conv3d(half, half, 1), Conv3d(half, channels, 3, stride=2)
        )
        self.conv2 = leaky_relu_between(
            TransposedConv3d(channels, half), Conv3d(half, half, 3), Conv3d(half, quarter, 1), LastConv3d(quarter, 1, 3)
        )
        self.layers = nn.ModuleList(ReversibleBlock(half) for _ in range(blocks))
        self.begin_at_first_video(self.conv2)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        published = self.operator(mask).mean_frame(measurement).unsqueeze(1) * (1 + mask)
        first = self.first_video(published, measurement, mask)
        features = self.conv1(as_one_channel(first.video))
        # In double precision the recomputed inputs of f and g, and so the gradients, equal the stored ones exactly.
        precise = torch.is_grad_enabled() and features.device.type != "mps"  # MPS has no double precision
        precise = precise and (self.reversible or not is_reduced(features))
        x1, x2 = features.to(torch.float64 if precise else features.dtype).chunk(2, dim=1)
        if self.reversible and torch.is_grad_enabled():
            x1, x2 = Reversed.apply(self.layers, x1, x2, *self.layers.parameters())
        else:
            for block in self.layers:
                x1, x2 = block(x1, x2)
        return first.plus(self.conv2(torch.cat([x1, x2], dim=1).to(features.dtype))[:, 0])
