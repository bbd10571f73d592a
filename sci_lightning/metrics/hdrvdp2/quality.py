"""The quality score Q of HDR-VDP-2, from two images to one number, and its mean over frames as a metric."""

from __future__ import annotations

import math
import warnings
from numbers import Real

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput
from sci_lightning.metrics.frame_metric import FrameMetric
from sci_lightning.metrics.hdrvdp2.eye import DISPLAYS, Display, band_sensitivity, filter_base, respond, scatter
from sci_lightning.metrics.hdrvdp2.steerable_pyramid import SMALLEST, steerable_pyramid
from sci_lightning.metrics.hdrvdp2.transforms import imresize

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


P, Q = 10**0.544068, 10**0.49576
SELF, ORIENTATIONS, NEIGHBOURS = 10**0.189065, 10**0.449199, 10**1.52512
"""Weights of masking by the band itself, by the other orientations, and by the neighbouring bands."""


def masked_differences(
    test: list[torch.Tensor], reference: list[torch.Tensor], sensitivity: list[torch.Tensor]
) -> list[torch.Tensor]:
    """Return the squared differences in units of their visibility threshold, for every band of two pyramids.

    Args:
        test, reference: bands (N, orientations, h, w) from fine to coarse.
        sensitivity: (N, 1, h, w) for every band, the inverse of the neural noise in it.
    """
    contrast = [_blur(torch.minimum(t.abs(), r.abs())) for t, r in zip(test, reference, strict=True)]
    differences = []
    for band, (t, r, s, own) in enumerate(zip(test, reference, sensitivity, contrast, strict=True)):
        gain = 2.0**band
        masking = SELF * (own * s / gain) ** Q
        if own.shape[1] > 1:
            masking = masking + ORIENTATIONS * ((own.sum(1, keepdim=True) - own).clamp(min=0) * s / gain) ** Q
        masking = gain * (masking + NEIGHBOURS * (_neighbours(contrast, band) * s) ** Q)
        excitation = gain**2 * ((t - r).abs() / gain) ** (2 * P)
        differences.append(excitation / (s ** (-2 * P) + masking**2))
    return differences


def _neighbours(contrast: list[torch.Tensor], band: int) -> torch.Tensor:
    """Return the contrast of the bands next to this one, resized to it; the base band masks only itself."""
    size, orientations = contrast[band].shape[-2:], contrast[band].shape[1]
    total = torch.zeros_like(contrast[band])
    for other, gain in ((band - 1, 2.0 ** (band - 1)), (band + 1, 2.0 ** (band + 1))):
        if 0 <= other < len(contrast) - 1:
            total = total + imresize(contrast[other][:, :orientations], size).clamp(min=0) / gain
    return total


def _blur(images: torch.Tensor) -> torch.Tensor:
    """Return the 3 x 3 mean, with zeros around."""
    return F.avg_pool2d(images, 3, stride=1, padding=1)


FREQUENCIES = (0.1172, 0.2344, 0.4688, 0.9375, 1.875, 3.75, 7.5, 15.0, 30.0, 60.0)
WEIGHTS = (0.0, 0.0, 0.0003, 0.0003, 0.0398, 0.2690, 0.2142, 0.2832, 0.2832, 0.0)
"""Weights of sub-bands at these frequencies in cycles per degree; linear interpolation in between."""
EPSILON = 1e-12


def pool(squares: list[torch.Tensor], frequencies: list[float]) -> torch.Tensor:
    """Return Q, (N,), from squared differences in all bands (N, orientations, h, w); 100 where there are none.

    A sub-band contributes the root of its sum, not of its mean, divided by its number of pixels.
    """
    q = torch.full((len(squares[0]),), 100.0, dtype=squares[0].dtype, device=squares[0].device)
    for band, rho in zip(squares, frequencies, strict=True):
        total = band.sum((-2, -1))
        root = torch.where(total > 0, total, 1.0).sqrt() * (total > 0)  # so that the gradient at 0 is 0, not undefined
        pooled = root / band[0, 0].numel()
        q = q - float(np.interp(rho, FREQUENCIES, WEIGHTS)) * torch.log1p(pooled / EPSILON).sum(1)
    return q


class HDRVDP2(FrameMetric):
    """The mean over frames of :func:`hdrvdp2_q`.

    Args:
        encoding, pixels_per_degree, dtype: see :func:`hdrvdp2_q`.
        clip_negative: whether estimates below 0 count as 0, as on a display; otherwise they are refused.

    Raises:
        BadInput: unknown encoding or impossible resolution; in ``update``, what :func:`hdrvdp2_q` refuses.

    Example:
        >>> truth = torch.linspace(0, 1, 8 * 32 * 32).reshape(8, 32, 32)
        >>> metric = HDRVDP2()
        >>> metric.update(0.9 * truth, truth)
        >>> print(f"{metric.compute():.2f}")
        89.58
    """

    smallest = SMALLEST
    plot_upper_bound = 100.0

    def __init__(
        self,
        encoding: str = "luma-display",
        pixels_per_degree: float = 30.0,
        *,
        clip_negative: bool = False,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        check_convention(encoding, pixels_per_degree)
        self.encoding = encoding
        self.pixels_per_degree = pixels_per_degree
        self.clip_negative = clip_negative
        self.computed_in = dtype
        self.convention = (
            f"Q of HDR-VDP-2.2.2, {encoding}, {pixels_per_degree:g} pixels per degree, per frame, mean over frames, "
            f"then over scenes{'; estimates below 0 count as 0' if clip_negative else ''}"
        )

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Return Q of every frame, ``(N,)``.

        Args:
            estimate, truth: ``(..., H, W)``, or with four axes or more ``(..., 3, H, W)`` for ``sRGB-display``.
        """
        if self.clip_negative:
            estimate = estimate.clamp(min=0)
        colour = self.encoding == "sRGB-display" and truth.dim() > 3
        test, reference = (x.reshape(-1, *x.shape[-3 if colour else -2 :]) for x in (estimate, truth))
        return hdrvdp2_q(
            test,
            reference,
            encoding=self.encoding,
            pixels_per_degree=self.pixels_per_degree,
            dtype=self.computed_in,
        )
