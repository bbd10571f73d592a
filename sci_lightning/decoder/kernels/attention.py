"""Attention in blocks that fit the processor's cache, with the softmax in the order that is fastest in memory."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels import block_sizes
from sci_lightning.decoder.kernels.reduced_precision import is_reduced


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
    reduced = is_reduced(x)
    values = block_sizes.ATTENTION_VALUES // c if reduced else block_sizes.ATTENTION_TOKENS
    # On meta as well, where the memory is counted that a processor would need.
    pixels = max(1, values // t) if x.device.type in ("cpu", "meta") else n * h * w

    def attend(tokens: torch.Tensor) -> torch.Tensor:
        """Return the attention among some of the pixels, ``(T, pixels, C)``."""
        t, pixels, _ = tokens.shape
        if reduced:  # one wide product, of which copies are cheaper than of three narrow ones
            joint = F.linear(tokens, qkv.weight, qkv.bias).view(t, pixels, 3, heads, -1)
            q, k, v = joint.permute(2, 1, 3, 0, 4).reshape(3, pixels * heads, t, -1)
        else:
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


def attention_in_windows(q: torch.Tensor, k: torch.Tensor, v: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Return ``softmax(D ** -0.5 q k^T + bias) v`` of every window and head, in the shape of v.

    Args:
        q, k, v: ``(.., windows, heads, pixels, D)``.
        bias: ``(windows or 1, heads, pixels, pixels)``.
    """
    if not is_reduced(q) or q.device.type != "cpu":
        return F.scaled_dot_product_attention(q, k, v, attn_mask=bias)
    # For windows of 49 pixels torch's fused attention takes twice as long as these steps, and its softmax in bfloat16
    # three times as long as that in float32, which is more exact as well.
    products = (q * q.shape[-1] ** -0.5) @ k.mT + bias.to(q.dtype)
    return F.softmax(products.float(), dim=-1).to(v.dtype) @ v


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
