"""Resampling of squares of light onto square pixels, with a Gaussian blur: the integral over both squares."""

from __future__ import annotations

import math

import torch

REACH = 4.0
"""Standard deviations beyond which a blur is cut off (6e-5 of the light are lost)."""
NEGLIGIBLE = 1e-15
"""Shares of light below it are 0: in float32 they may become denormal numbers, which processors multiply a hundred
times as slowly as others."""


def square_kernel(
    distance: torch.Tensor, sigma: torch.Tensor | None, pixel: torch.Tensor | float = 1.0
) -> torch.Tensor:
    r"""Return the share of a unit square's light that falls on a pixel, in one dimension.

    :math:`\frac{1}{b} (\mathrm{box}_1 * \mathcal{N}_\sigma * \mathrm{box}_b)(d)`, from the second antiderivative of
    the Gaussian. Without a blur and for b = 1 it is the triangle, so that a displacement is linear interpolation.

    Args:
        distance: d between the centres, in units of the square; any shape.
        sigma: standard deviation of the blur, same unit; None for no blur.
        pixel: b, width of the pixel, same unit.
    """
    wide, narrow = (1 + pixel) / 2, (1 - pixel) / 2
    given = distance.dtype
    distance = (
        distance.double().abs().neg()
    )  # far out on the negative side the antiderivatives are near 0, so that no digits cancel
    edges = (distance + wide, distance + narrow, distance - narrow, distance - wide)
    a, b, c, d = (_twice_integrated(edge, sigma) for edge in edges)
    return without_negligible((a - b - c + d) / pixel).to(given)


def without_negligible(weights: torch.Tensor) -> torch.Tensor:
    """Return weights of which those below ``NEGLIGIBLE`` are 0."""
    return torch.where(weights.abs() < NEGLIGIBLE, torch.zeros_like(weights), weights)


def _twice_integrated(x: torch.Tensor, sigma: torch.Tensor | None) -> torch.Tensor:
    """Return the second antiderivative of a Gaussian at x (of a delta function, without sigma)."""
    if sigma is None:
        return x.clamp(min=0)
    z = x / (math.sqrt(2) * sigma)
    return 0.5 * x * torch.erfc(-z) + sigma / math.sqrt(2 * math.pi) * torch.exp(-z.square())


def reach(sigma: float, pixel: float = 1.0) -> int:
    """Return how many squares on either side of a pixel's centre can send light to it."""
    return math.ceil((1 + pixel) / 2 + REACH * sigma - 1e-6)
