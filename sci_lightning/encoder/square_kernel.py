"""Squares of light, blurred, on square pixels: the weights of a resampling that integrates over both."""

from __future__ import annotations

import math

import torch

REACH = 4.0
"""Standard deviations of a blur beyond which nothing is left (6e-5 of the light)."""


def square_kernel(
    distance: torch.Tensor, sigma: torch.Tensor | None, pixel: torch.Tensor | float = 1.0
) -> torch.Tensor:
    r"""The share of a unit square's light that falls on a pixel, in one dimension.

    :math:`\frac{1}{b} (\mathrm{box}_1 * \mathcal{N}_\sigma * \mathrm{box}_b)(d)`, by the second antiderivative of the
    Gaussian. Without a blur and for b = 1 it is the triangle, so that moving squares is linear interpolation.

    Args:
        distance: d between the centres, in units of the square; any shape.
        sigma: of the blur, same unit; None for none.
        pixel: b, width of the pixel, same unit.
    """
    wide, narrow = (1 + pixel) / 2, (1 - pixel) / 2
    given = distance.dtype
    distance = distance.double().abs().neg()  # far out on this side antiderivatives are near 0: nothing cancels
    edges = (distance + wide, distance + narrow, distance - narrow, distance - wide)
    a, b, c, d = (_twice_integrated(edge, sigma) for edge in edges)
    return ((a - b - c + d) / pixel).to(given)


def _twice_integrated(x: torch.Tensor, sigma: torch.Tensor | None) -> torch.Tensor:
    """Second antiderivative of a Gaussian (of a spike, without sigma)."""
    if sigma is None:
        return x.clamp(min=0)
    z = x / sigma
    density = torch.exp(-z.square() / 2) / math.sqrt(2 * math.pi)
    return x * torch.special.ndtr(z) + sigma * density


def reach(sigma: float, pixel: float = 1.0) -> int:
    """How many squares on either side of a pixel's centre can send light to it."""
    return math.ceil((1 + pixel) / 2 + REACH * sigma - 1e-6)
