"""Footprints of pixels on the mirrors, put together from upright rectangles."""

from __future__ import annotations

import torch

from sci_lightning.encoder.square_kernel import reach, square_kernel


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
