"""How much light every mirror sends to the footprint of a pixel, and the images of mirrors that follow from it."""

from __future__ import annotations

import math
from itertools import repeat

import torch

REACH = 4.0
"""Standard deviations beyond which a blur is cut off (6e-5 of the light are lost)."""
NEGLIGIBLE = 1e-15
"""Shares of light below it are 0: in float32 they may become denormal numbers, which processors multiply a hundred
times as slowly as others."""
TAPS_AT_A_TIME = 2**22
"""Mirrors of pixels whose shares of light are kept at a time: 64 MiB of places and weights."""
TABULATED = 4096
"""Places between two mirrors at which the kernel of a blur is computed. Linear interpolation is right to a hundred
millionth of the light over the blur's standard deviation in mirrors, as single precision is."""


def square_kernel(
    distance: torch.Tensor,
    sigma: torch.Tensor | None,
    pixel: torch.Tensor | float = 1.0,
    side: torch.Tensor | float = 1.0,
) -> torch.Tensor:
    r"""Return the share of a mirror's light that falls on a pixel, in one dimension.

    :math:`\frac{1}{a b} (\mathrm{box}_a * \mathcal{N}_\sigma * \mathrm{box}_b)(d)`, from the second antiderivative of
    the Gaussian. Without a blur and for a = b = 1 it is the triangle, so that a displacement is linear interpolation.

    Args:
        distance: d between the centres, in units of the mirrors' pitch; any shape.
        sigma: standard deviation of the blur, same unit; None for no blur.
        pixel: b, width of the pixel, same unit.
        side: a, width of the mirror, same unit.
    """
    wide, narrow = (side + pixel) / 2, (side - pixel) / 2
    given = distance.dtype
    # far out on the negative side the antiderivatives are near 0, so that no digits cancel
    distance = distance.double().abs().neg()
    edges = (distance + wide, distance + narrow, distance - narrow, distance - wide)
    a, b, c, d = (_twice_integrated(edge, sigma) for edge in edges)
    return without_negligible((a - b - c + d) / (pixel * side)).to(given)


def without_negligible(weights: torch.Tensor) -> torch.Tensor:
    """Return weights of which those below ``NEGLIGIBLE`` are 0."""
    return torch.where(weights.abs() < NEGLIGIBLE, torch.zeros_like(weights), weights)


def _twice_integrated(x: torch.Tensor, sigma: torch.Tensor | None) -> torch.Tensor:
    """Return the second antiderivative of a Gaussian at x (of a delta function, without sigma)."""
    if sigma is None:
        return x.clamp(min=0)
    z = x / (math.sqrt(2) * sigma)
    return 0.5 * x * torch.erfc(-z) + sigma / math.sqrt(2 * math.pi) * torch.exp(-z.square())


def reach(sigma: torch.Tensor | None, pixel: torch.Tensor | float = 1.0) -> int:
    """Return how many squares on either side of a pixel's centre can send light to it; arguments as above."""
    blur = 0.0 if sigma is None else float(sigma.detach().max())
    width = float(pixel.detach().max()) if isinstance(pixel, torch.Tensor) else pixel
    return math.ceil((1 + width) / 2 + REACH * blur - 1e-6)


def shares(
    centre: torch.Tensor,
    sigma: torch.Tensor | None,
    pixel: torch.Tensor,
    length: int,
    side: torch.Tensor | float = 1.0,
) -> torch.Tensor:
    """Return ``(cells, length)``: how much every mirror lights every cell, along one axis."""
    return square_kernel(centre[:, None] - torch.arange(length).to(centre), sigma, pixel, side)


def blurs_onto_pixels(length: int, cells: int, sigma: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """Return blurs of uniform cells along one axis, integrated over pixels, dark beyond them: ``(.., pixels, length)``.

    They are dense matrices, which are faster than wide convolutions, of the type of ``like``.

    Args:
        length: number of cells.
        cells: of them in a pixel.
        sigma: ``(..)`` standard deviations in pixels, above 0.
        like: any tensor.
    """
    cell = torch.arange(length, device=like.device)
    distance = torch.arange(1 - length, length - cells + 1).to(like) + (cells - 1) / 2  # that occur, each once
    shares = square_kernel(distance, sigma[..., None] * cells, cells)
    return shares[..., cell[: length // cells, None] * cells - cell + length - 1]


def blurred(patterns: torch.Tensor, sigma: torch.Tensor, axis: int) -> torch.Tensor:
    """Return patterns blurred along an axis by a Gaussian of ``sigma`` mirrors, dark beyond their edges."""
    distance = torch.arange(patterns.shape[axis], dtype=torch.float64, device=patterns.device)
    weight = torch.exp(-((distance[:, None] - distance) / sigma).square() / 2) / (sigma * math.sqrt(2 * math.pi))
    weight = without_negligible(weight).to(patterns.dtype)
    return weight @ patterns if axis == -2 else patterns @ weight


def image_at(
    patterns: torch.Tensor,
    row: torch.Tensor,
    column: torch.Tensor,
    sigma: tuple[torch.Tensor | None, torch.Tensor | None],
    pixel: tuple[torch.Tensor, torch.Tensor],
    side: torch.Tensor | float = 1.0,
) -> torch.Tensor:
    """Return the image of mirrors seen at fields of rows and columns, by pixels and blurs of so many mirrors.

    ``side`` is the width of a mirror, as a part of their pitch.
    """
    height, width = patterns.shape[-2:]
    values = patterns.flatten(-2).mT.contiguous()  # of a mirror side by side, so that it is read at once
    row, column = torch.broadcast_tensors(row, column)
    field = row.shape
    across = 2 * max(reach(blur, side) for blur, side in zip(sigma, pixel, strict=True))
    at_a_time = max(1, TAPS_AT_A_TIME // across**2)
    places = [one.flatten().split(at_a_time) for one in (row, column)]
    extents = [one.expand(field).flatten().split(at_a_time) if one.ndim else repeat(one) for one in pixel]
    parts = []
    for y, x, high, wide in zip(*places, *extents, strict=False):
        index_down, down = _taps(y, sigma[0], high, height, side)
        index_over, over = _taps(x, sigma[1], wide, width, side)
        index = index_down[:, :, None] * width + index_over[:, None, :]
        weight = (down[:, :, None] * over[:, None, :]).to(patterns.dtype)
        parts.append(
            torch.nn.functional.embedding_bag(
                index.flatten(1), values, per_sample_weights=weight.flatten(1), mode="sum"
            )
        )
    return torch.cat(parts).mT.reshape(-1, *field)


def _taps(
    centre: torch.Tensor,
    sigma: torch.Tensor | None,
    pixel: torch.Tensor,
    length: int,
    side: torch.Tensor | float,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return indices and weights ``(.., taps)`` of all the mirrors that may light the pixels around ``centre`` (..)."""
    radius = reach(sigma, pixel)
    steps = torch.arange(1 - radius, radius + 1, device=centre.device)
    first = torch.floor(centre.detach())
    index = first.long()[..., None] + steps
    if sigma is None or pixel.ndim:
        weight = square_kernel(centre[..., None] - index, sigma, pixel[..., None], side)
    else:  # one kernel everywhere, which the blur has made smooth
        fraction = (centre - first) * TABULATED
        node = fraction.detach().long().clamp(max=TABULATED - 1)
        nodes = torch.arange(TABULATED + 1, dtype=torch.float64, device=centre.device) / TABULATED
        table = square_kernel(nodes[:, None] - steps, sigma, pixel, side).to(centre.dtype)
        weight = torch.lerp(table[node], table[node + 1], (fraction - node)[..., None])
    return index.clamp(0, length - 1), weight * ((index >= 0) & (index < length))


def image_by_parts(
    patterns: torch.Tensor,
    centre: tuple[torch.Tensor, torch.Tensor],
    sigma: tuple[torch.Tensor | None, torch.Tensor | None],
    extent: tuple[torch.Tensor, torch.Tensor],
    divided: int,
    side: torch.Tensor | float = 1.0,
) -> torch.Tensor:
    """Return the image ``(P, H, W)`` of square mirrors, ``(P, Hm, Wm)``, dark beyond them.

    The parts' shares of every mirror are added up before any pattern is looked at, so that finer parts cost little
    where patterns are many.

    Args:
        patterns: transmittance of the mirrors.
        centre: row and column that the centres of the parts see, ``(divided H, divided W)`` each, in mirrors.
        sigma: standard deviations of the blur at the parts, of the same shape, in mirrors; None for no blur.
        extent: height and width of the parts' footprints, of the same shape, in mirrors.
        divided: parts along either axis of a pixel.
        side: width of a mirror, as a part of their pitch.
    """
    height, width = (length // divided for length in centre[0].shape)
    rows, columns = patterns.shape[-2:]
    flat, parts = patterns.flatten(-2), divided**2
    axes = [
        (_by_part(one, divided), None if blur is None else _by_part(blur, divided), _by_part(size, divided), length)
        for one, blur, size, length in zip(centre, sigma, extent, (rows, columns), strict=True)
    ]
    (down, line), (over, mirror) = (_shares_of_parts(*axis, side) for axis in axes)
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


def _shares_of_parts(
    centre: torch.Tensor,
    sigma: torch.Tensor | None,
    extent: torch.Tensor,
    length: int,
    side: torch.Tensor | float,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return shares of mirrors along one axis in parts, ``(parts, pixels, n)``, and which these are, ``(pixels, n)``.

    The n mirrors are those that light any part of a pixel.
    """
    radius = reach(sigma, extent)
    seen = torch.floor(centre.detach()).long()
    first = seen.amin(0) - radius + 1
    count = int((seen.amax(0) + radius - first).max()) + 1
    index = first[:, None] + torch.arange(count, device=centre.device)
    blur = None if sigma is None else sigma[..., None]
    share = square_kernel(centre[..., None] - index, blur, extent[..., None], side)
    return share * ((index >= 0) & (index < length)), index.clamp(0, length - 1)
