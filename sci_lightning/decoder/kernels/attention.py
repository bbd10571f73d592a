"""Attention in blocks that fit the processor's cache, with the softmax in the order that is fastest in memory."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels import block_sizes


def attention_along_time(
    x: torch.Tensor, qkv: nn.Linear, proj: nn.Linear, heads: int, scale: float, bias: Callable[[], torch.Tensor] | None
) -> torch.Tensor:
    """Return multi-head attention over the T features of every pixel, ``(N, C, T, H, W)`` to the same.

    Args:
        x: features, fastest in channels-last layout.
        qkv: projection to queries, keys and values, one after another.
        proj: projection of the heads' results to C channels.
        heads: number of heads.
        scale: factor of the products of queries and keys.
        bias: returns what is added to these products, ``(heads, T of keys, T of queries)``; None for nothing.
    """
    n, c, t, h, w = x.shape
    # Slots first, as the features lie in memory: every product below reads them where they are.
    tokens = x.permute(2, 0, 3, 4, 1).reshape(t, n * h * w, c)
    # On meta as well, where the memory is counted that a processor would need.
    pixels = max(1, block_sizes.ATTENTION_TOKENS // t) if x.device.type in ("cpu", "meta") else n * h * w

    def attend(tokens: torch.Tensor) -> torch.Tensor:
        """Return the attention among some of the pixels, ``(T, pixels, C)``."""
        t, pixels, _ = tokens.shape
        biases = (None, None, None) if qkv.bias is None else qkv.bias.chunk(3)
        q, k, v = (
            F.linear(tokens, weight, part).view(t, pixels * heads, -1).transpose(0, 1)
            for weight, part in zip(qkv.weight.chunk(3), biases, strict=True)
        )
        products = scale * (k @ q.transpose(1, 2))  # (pixel and head, slot of the key, slot of the query)
        if bias is not None:
            products = (products.view(-1, heads, t, t) + bias()).view_as(products)
        # Over the first dimension: over a last one as short as T, torch's softmax takes longer than all the rest.
        weights = F.softmax(products.movedim(1, 0), dim=0).movedim(0, 2)
        mixed: torch.Tensor = proj((weights @ v).transpose(0, 1).reshape(t, pixels, -1))
        return mixed

    # Contiguous parts: otherwise each of the three projections copies a part, and keeps the copy for its gradient.
    mixed = torch.cat([attend(part.contiguous()) for part in tokens.split(pixels, dim=1)], dim=1)
    return mixed.view(t, n, h, w, c).permute(1, 4, 0, 2, 3)


def weighted_sum_of_positions(keys: torch.Tensor, queries: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Return ``values @ softmax(keys^T @ queries)``, ``(N, C, P)``, without ever holding all P x P weights.

    Args:
        keys, queries: ``(N, D, P)`` at the P positions; the softmax runs over the queries.
        values: ``(N, C, P)``.
    """
    rows = max(1, block_sizes.POSITION_WEIGHTS // keys.shape[2])
    total = torch.zeros_like(values)
    for block, part in zip(keys.split(rows, -1), values.split(rows, -1), strict=True):
        total = torch.baddbmm(total, part, torch.softmax(block.transpose(1, 2) @ queries, dim=-1))
    return total


def frame_by_frame(function: Callable[[torch.Tensor], torch.Tensor], frames: torch.Tensor) -> torch.Tensor:
    """Return ``function`` of every frame ``(F, ...)``, one after another: what one frame needs fits the cache."""
    return torch.stack([function(frame) for frame in frames])


def neighbourhood_product(features: torch.Tensor, kernels: torch.Tensor) -> torch.Tensor:
    """Return the products of 3 x 3 neighbourhoods with kernels of their own, summed in place without copies of them.

    Args:
        features: ``(N, C, T, H, W)``, zeros around.
        kernels: ``(N, C, 9, 1, H, W)``, the nine taps row by row.
    """
    height, width = features.shape[-2:]
    padded = F.pad(features, (1, 1, 1, 1))
    total = torch.zeros_like(features)
    for number, tap in enumerate(kernels.unbind(2)):
        row, column = divmod(number, 3)
        total.addcmul_(tap, padded[..., row : row + height, column : column + width])
    return total
