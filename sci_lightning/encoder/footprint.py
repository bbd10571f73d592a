"""Footprints of pixels on the mirrors, put together from upright rectangles."""

from __future__ import annotations

import math

import torch


def image_by_parts(
    patterns: torch.Tensor,
    place: tuple[torch.Tensor, torch.Tensor],
    sigma: tuple[torch.Tensor | None, torch.Tensor | None],
    side: tuple[torch.Tensor, torch.Tensor],
    divided: int,
) -> torch.Tensor:
    """Return the image ``(P, H, W)`` of touching square mirrors, ``(P, Hm, Wm)``, dark beyond them.

    The parts' shares of every mirror are added up before any pattern is looked at, so that finer parts cost little
    where patterns are many.

    Args:
        patterns: transmittance of the mirrors.
        place: row and column that the centres of the parts see, ``(divided H, divided W)`` each, in mirrors.
        sigma: standard deviations of the blur at the parts, of the same shape, in mirrors; None for no blur.
        side: height and width of the parts' footprints, of the same shape, in mirrors.
        divided: parts along either axis of a pixel.
    """
    height, width = (length // divided for length in place[0].shape)
    rows, columns = patterns.shape[-2:]
    flat, parts = patterns.flatten(-2), divided**2
    axes = [
        (_by_part(one, divided), None if blur is None else _by_part(blur, divided), _by_part(extent, divided), length)
        for one, blur, extent, length in zip(place, sigma, side, (rows, columns), strict=True)
    ]
    (down, line), (over, mirror) = (_shares(*axis) for axis in axes)
    weight = (torch.einsum("snr,snc->rcn", down, over) / parts).to(patterns.dtype)
    image = torch.zeros(len(patterns), height * width, dtype=patterns.dtype, device=patterns.device)
    for r, one in enumerate(line.T):
        for c, other in enumerate(mirror.T):
            image = image + flat[:, one * columns + other] * weight[r, c]
    return image.unflatten(1, (height, width))


def _by_part(field: torch.Tensor, divided: int) -> torch.Tensor:
    """Return a field of parts, ``(divided H, divided W)``, as ``(parts of a pixel, pixels)``."""
    height, width = (length // divided for length in field.shape)
    return field.view(height, divided, width, divided).permute(1, 3, 0, 2).reshape(divided**2, height * width)


def _shares(
    place: torch.Tensor, sigma: torch.Tensor | None, side: torch.Tensor, length: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return shares of mirrors along one axis in parts, ``(parts, pixels, n)``, and which these are, ``(pixels, n)``.

    The n mirrors are those that light any part of a pixel.
    """
    radius = reach(0.0 if sigma is None else float(sigma.detach().max()), float(side.detach().max()))
    seen = torch.floor(place.detach()).long()
    first = seen.amin(0) - radius + 1
    count = int((seen.amax(0) + radius - first).max()) + 1
    index = first[:, None] + torch.arange(count, device=place.device)
    blur = None if sigma is None else sigma[..., None]
    share = square_kernel(place[..., None] - index, blur, side[..., None])
    return share * ((index >= 0) & (index < length)), index.clamp(0, length - 1)


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
