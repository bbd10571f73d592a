"""3 x 3 convolution of frames with a quarter of the multiplications: Winograd's minimal filtering on 4 x 4 tiles.

A tile of 6x6 inputs and the 3x3 kernel are read as polynomials, evaluated at six points each way, multiplied there
(36 products instead of 144 for the 4x4 outputs), and read back. Products at one point, over all tiles and channels, are
one matrix product. Taps along time are summed at the points, so a 3x3x3 kernel is transformed once, not three times.
Source: Winograd, "Arithmetic complexity of computations" (1980); Lavin and Gray, "Fast algorithms for convolutional
neural networks" (2016).
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch.autograd.function import FunctionCtx, once_differentiable
from torch.nn import functional as F

WINOGRAD_TILES = 256
"""Tiles of 4 x 4 outputs whose 36 products are computed together, so that they stay in a processor's cache (measured on
x86-64 cores with 1 to 2 MB of level 2); it changes results in the last bits at most."""
TILE = 4
READ = TILE + 2  # side of the square of inputs on which a tile's outputs depend
# The sixth point is infinity. Pairs of reciprocals keep the powers small: with the usual 0, 1, -1, 2, -2 the rounding
# error is 2e-6 (r.m.s., 64 channels), with these 8e-7, and in a direct convolution 2e-7.
POINTS = (0, 2 / 3, -2 / 3, 3 / 2, -3 / 2)


def winograd(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Return ``F.conv3d(x, weight, bias, padding=(taps // 2, 1, 1))`` to rounding, in channels-last layout.

    Args:
        x: ``(N, C, T, H, W)``.
        weight: ``(O, C, taps, 3, 3)``, taps odd.
        bias: ``(O,)``.
    """
    return Winograd.apply(x, weight, bias)


class Winograd(torch.autograd.Function):
    """The convolution and its gradients; as for any convolution, only the inputs are kept for the backward pass."""

    @staticmethod
    def forward(ctx: FunctionCtx, x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        return convolved(x, weight).add_(bias.view(-1, 1, 1, 1))

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:  # type: ignore[no-untyped-def]
        x, weight = ctx.saved_tensors
        return (
            convolved(gradient, weight.flip(2, 3, 4).transpose(0, 1)) if ctx.needs_input_grad[0] else None,
            weight_gradient(x, gradient, weight.shape[2]) if ctx.needs_input_grad[1] else None,
            gradient.sum((0, 2, 3, 4)) if ctx.needs_input_grad[2] else None,
        )


def matrices(like: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return A (16 x 36), G (36 x 9), B (36 x 36) with outputs = A ((G kernel) * (B inputs)), tiles row by row."""
    points = torch.tensor(POINTS, dtype=torch.float64)

    def values(degree: int) -> torch.Tensor:
        """Return the matrix that evaluates a polynomial of so many coefficients; at infinity it is the highest one."""
        finite = points[:, None] ** torch.arange(degree)
        return torch.cat([finite, torch.eye(degree, dtype=torch.float64)[-1:]])

    one_way = values(TILE).T, values(3), torch.linalg.inv(values(READ)).T
    a, g, b = (torch.kron(matrix, matrix).to(like) for matrix in one_way)
    return a, g, b


def convolved(x: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return the convolution without bias, ``(N, O, T, H, W)`` in channels-last layout."""
    n, c, t, h, w = x.shape
    outputs, _, taps = weight.shape[:3]
    a, g, b = matrices(x)
    kernel = (g @ weight.flatten(3).permute(3, 2, 1, 0).flatten(1)).view(-1, taps, c, outputs)
    shape = n, outputs, t, h + -h % TILE, w + -w % TILE
    y = torch.empty(shape, dtype=x.dtype, device=x.device, memory_format=torch.channels_last_3d)
    blocks = y.permute(0, 2, 3, 4, 1).unflatten(3, (-1, TILE)).unflatten(2, (-1, TILE))
    for snapshot, rows, tiles in strips(x):
        values = at_points(b, tiles, t, c, taps)
        products = values.new_empty(len(b), t * values.shape[2], outputs)
        for tap in range(taps):  # beta = 0 overwrites the uninitialised memory
            products.baddbmm_(values[:, tap : tap + t].flatten(1, 2), kernel[:, tap], beta=min(tap, 1))
        strip = (a @ products.view(len(b), -1)).view(TILE, TILE, t, -1, blocks.shape[4], outputs)
        blocks[snapshot, :, rows] = strip.permute(2, 3, 0, 4, 1, 5)
    whole = shape[3:] == (h, w)
    return y if whole else y[..., :h, :w].contiguous(memory_format=torch.channels_last_3d)


def weight_gradient(x: torch.Tensor, gradient: torch.Tensor, taps: int) -> torch.Tensor:
    """Return the gradient with respect to the weight, ``(O, C, taps, 3, 3)``, from that of the outputs."""
    _, c, t, h, w = x.shape
    outputs = gradient.shape[1]
    a, g, b = matrices(x)
    frames = F.pad(gradient.permute(0, 2, 3, 4, 1), (0, 0, 0, -w % TILE, 0, -h % TILE))
    blocks = frames.unflatten(3, (-1, TILE)).unflatten(2, (-1, TILE)).permute(3, 5, 0, 1, 2, 4, 6)
    kernel = x.new_zeros(taps, len(b), c, outputs)
    for snapshot, rows, tiles in strips(x):
        values = at_points(b, tiles, t, c, taps)
        products = (a.T @ blocks[:, :, snapshot, :, rows].reshape(TILE**2, -1)).view(len(b), -1, outputs)
        for tap in range(taps):
            kernel[tap].baddbmm_(values[:, tap : tap + t].flatten(1, 2).mT, products)
    return (g.T @ kernel.transpose(0, 1).flatten(1)).view(3, 3, taps, c, outputs).permute(4, 3, 2, 0, 1)


def at_points(b: torch.Tensor, tiles: torch.Tensor, t: int, c: int, taps: int) -> torch.Tensor:
    """Return a strip's values at the points, ``(36, T + taps - 1, tiles of a frame, C)``, between frames of zeros.

    Because of the zeros, every tap is a batch of matrix products of one size into contiguous memory. Torch computes
    only such a batch as one, and any other as 36 products that wait for all threads one after another.
    """
    before = taps // 2
    values = tiles.new_empty(len(b), t + taps - 1, tiles.shape[1] // t)
    values[:, :before] = values[:, before + t :] = 0
    torch.mm(b, tiles, out=values[:, before : before + t].flatten(1))
    return values.unflatten(2, (-1, c))


def strips(x: torch.Tensor) -> Iterator[tuple[int, slice, torch.Tensor]]:
    """Yield a few rows of tiles at a time: (snapshot, slice of rows, their inputs ``(36, T * rows * columns * C)``)."""
    n, _, t, h, w = x.shape
    frames = F.pad(x.permute(0, 2, 3, 4, 1), (0, 0, 1, -w % TILE + 1, 1, -h % TILE + 1))
    tiles = frames.unfold(2, READ, TILE).unfold(3, READ, TILE).permute(5, 6, 0, 1, 2, 3, 4)
    step = max(1, WINOGRAD_TILES // (t * tiles.shape[5]))
    for snapshot in range(n):
        for start in range(0, tiles.shape[4], step):
            rows = slice(start, start + step)
            yield snapshot, rows, tiles[:, :, snapshot, :, rows].reshape(READ**2, -1)
