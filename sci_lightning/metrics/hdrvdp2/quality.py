"""The quality score Q of HDR-VDP-2, from two images to one number."""

from __future__ import annotations

import math
import warnings
from numbers import Real

import torch

from sci_lightning.errors import BadInput
from sci_lightning.metrics.hdrvdp2.contrast_sensitivity import band_sensitivity, filter_base
from sci_lightning.metrics.hdrvdp2.display import DISPLAYS, Display
from sci_lightning.metrics.hdrvdp2.eye import respond, scatter
from sci_lightning.metrics.hdrvdp2.imresize import imresize
from sci_lightning.metrics.hdrvdp2.masking import masked_differences, pool
from sci_lightning.metrics.hdrvdp2.steerable_pyramid import SMALLEST, steerable_pyramid

TOGETHER = 4 * 256 * 256
"""Pixels of the pairs that are computed together: memory does not grow with the batch, and more of it fits caches."""
CHANGE = 0.001
"""Relative difference in luminance up to which a pixel counts as unchanged."""


def hdrvdp2_q(
    test: torch.Tensor,
    reference: torch.Tensor,
    *,
    encoding: str = "luma-display",
    pixels_per_degree: float = 30.0,
    dtype: torch.dtype = torch.float64,
) -> torch.Tensor:
    """Return Q of HDR-VDP-2.2.2 (Mantiuk et al., 2011; Narwaria et al., 2015) for every pair of images.

    Q is 100 for equal images and falls with their difference, without a lower bound. It depends on the size of the
    images and strongly on ``pixels_per_degree``: compare values of one convention only. It is differentiable in both
    images, except that a pixel is masked out where the luminances differ by less than 0.1 %.

    Args:
        test, reference: ``(N, H, W)``, H and W at least 17, or ``(N, 3, H, W)`` for ``sRGB-display``, where gray frames
            stand for three equal channels. Floating-point and not negative; 1.0 is white, or cd/m2 for ``luminance``.
            Nothing is clipped.
        encoding: ``luma-display`` (gamma 2.2, 1 to 100 cd/m2), ``sRGB-display`` (the same range) or ``luminance``.
        pixels_per_degree: pixels per degree of visual angle.
        dtype: precision of the computation; results in float32 differ by up to 0.001.

    Returns:
        ``(N,)`` of ``dtype``.

    Raises:
        BadInput: an argument is not as described above.
    """
    display = check_convention(encoding, pixels_per_degree)
    _check_images(test, reference, encoding, dtype)
    if encoding == "luminance" and reference.max() <= 1:
        warnings.warn("encoding=luminance takes cd/m2, and the reference has at most 1 of them", stacklevel=2)
    together = max(1, TOGETHER // test.shape[-2:].numel())
    pairs = zip(test.to(dtype).split(together), reference.to(dtype).split(together), strict=True)
    with torch.autocast(test.device.type, enabled=False):
        return torch.cat([_q(t, r, display, float(pixels_per_degree)) for t, r in pairs])


def _q(test: torch.Tensor, reference: torch.Tensor, display: Display, pixels_per_degree: float) -> torch.Tensor:
    pairs = len(test)
    images = torch.cat((test, reference))
    light = display.luminance(images if images.dim() == 4 else images.unsqueeze(1))
    receptors = display.receptors(scatter(light, pixels_per_degree))
    adaptation = receptors[:, :2].sum(1, keepdim=True)
    bands = steerable_pyramid(respond(receptors))
    frequencies = [pixels_per_degree / 2 ** (band + 1) for band in range(len(bands))]

    padding = bands[-1][pairs:].mean((-2, -1), keepdim=True).repeat(2, 1, 1, 1)
    bands[-1] = filter_base(bands[-1], frequencies[-1], adaptation.mean((-2, -1), keepdim=True), padding)
    test_bands, reference_bands = ([band[half] for band in bands] for half in (slice(pairs), slice(pairs, None)))

    adapted = ((adaptation[:pairs] + adaptation[pairs:]) / 2).clamp(1e-5, 1e5).log10()
    sizes = [band.shape[-2:] for band in bands]
    fine = zip(frequencies[:-1], sizes[:-1], strict=True)
    sensitivity = [band_sensitivity(rho, imresize(adapted, size)) for rho, size in fine]
    sensitivity.append(torch.ones_like(test_bands[-1]))  # the base band is filtered with its sensitivity above

    before, after = light[pairs:], light[:pairs]
    changed = ((after - before).abs() / before > CHANGE).any(1, keepdim=True).to(light)  # never for 0/0
    squares = masked_differences(test_bands, reference_bands, sensitivity)
    return pool([band * imresize(changed, size) ** 2 for band, size in zip(squares, sizes, strict=True)], frequencies)


def check_convention(encoding: str, pixels_per_degree: float) -> Display:
    """Return the display of this encoding; raise :class:`BadInput` if there is none or the resolution is impossible."""
    if encoding not in DISPLAYS:
        raise BadInput(f"encoding={encoding}: no such encoding; choose one of {', '.join(DISPLAYS)}")
    if not isinstance(pixels_per_degree, Real) or not 0 < pixels_per_degree < math.inf:
        raise BadInput(f"pixels_per_degree={pixels_per_degree}: must be a positive number; 30 is typical")
    return DISPLAYS[encoding]


def _check_images(test: torch.Tensor, reference: torch.Tensor, encoding: str, dtype: torch.dtype) -> None:
    if dtype not in (torch.float64, torch.float32):
        raise BadInput(f"dtype={dtype}: the Q-Score is computed in torch.float64 or torch.float32")
    if test.shape != reference.shape:
        raise BadInput(f"test is {tuple(test.shape)} and reference {tuple(reference.shape)}: must be of one shape")
    shape = tuple(test.shape)
    if not (test.dim() == 3 or (test.dim() == 4 and shape[1] == 3 and encoding == "sRGB-display")) or shape[0] == 0:
        raise BadInput(f"images are {shape}: must be (N, H, W), or (N, 3, H, W) with encoding=sRGB-display, N from 1")
    if min(shape[-2:]) < SMALLEST:
        raise BadInput(f"the Q-Score needs at least {SMALLEST} x {SMALLEST} pixels, got {shape[-2]} x {shape[-1]}")
    for name, images in (("test", test), ("reference", reference)):
        if not images.is_floating_point():
            raise BadInput(f"{name} is {images.dtype}: must be floating-point; for 8 bits, images / 255")
        if not images.isfinite().all():
            raise BadInput(f"{name} has values that are NaN or infinite: must be finite")
        if (images < 0).any():
            raise BadInput(f"{name} has negative values, down to {float(images.min()):.4g}: clip them to 0 first")
