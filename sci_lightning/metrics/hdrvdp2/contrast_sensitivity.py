"""Neural contrast sensitivity: that of the eye without its optics and photoreceptors."""

from __future__ import annotations

import math

import torch

from sci_lightning.metrics.hdrvdp2.fourier import frequencies, spectrum, upper_left
from sci_lightning.metrics.hdrvdp2.tabulated import log_luminances, look_up, precomputed

POINTS = 256
LUMINANCE = (0.002, 0.02, 0.2, 2.0, 20.0, 150.0)
PARAMETERS = (
    (0.991265, 0.800889, 0.476505, 0.405782, 0.334278, 0.394533),
    (3.74038, 3.54104, 4.37453, 4.40602, 3.79542, 2.7755),
    (0.50722, 0.682505, 0.750315, 0.935314, 1.07327, 1.16577),
    (4.46044, 4.94958, 5.28678, 5.61425, 6.4635, 7.45665),
)
"""Parameters of the sensitivity at each of these luminances (cd/m2), as fitted by the metric's authors."""


def sensitivity(rho: torch.Tensor, log_luminance: torch.Tensor) -> torch.Tensor:
    """Return the sensitivity at ``rho`` cycles per degree of an eye adapted to ``log_luminance`` (log10 cd/m2)."""
    knots = torch.tensor(LUMINANCE, dtype=torch.float64).log10().to(log_luminance)
    luminance = log_luminance.clamp(knots[0], knots[-1])
    above = torch.searchsorted(knots, luminance.detach().contiguous()).clamp(1, len(knots) - 1)
    part = (luminance - knots[above - 1]) / (knots[above] - knots[above - 1])
    p1, p2, p3, p4 = (
        torch.lerp(values[above - 1], values[above], part)
        for values in torch.tensor(PARAMETERS, dtype=torch.float64).to(log_luminance)
    )
    return p4 * (-torch.expm1(-((rho / 7) ** 2))) ** (p3 / 2) / torch.sqrt(1 + (p1 * rho) ** p2)


def band_sensitivity(rho: float, log_luminance: torch.Tensor) -> torch.Tensor:
    """Return the sensitivity at one frequency and a luminance per pixel, from a table."""
    return look_up(_table(log_luminance, rho), log_luminance)


@precomputed
def _table(rho: float) -> torch.Tensor:
    return sensitivity(torch.tensor(rho, dtype=torch.float64), log_luminances(POINTS))


def filter_base(base: torch.Tensor, rho: float, luminance: torch.Tensor, padding: torch.Tensor) -> torch.Tensor:
    """Return the pyramid's base band (N, 1, h, w) filtered with the sensitivity, which is 0 at frequency 0.

    Args:
        rho: nominal frequency of the band, cycles per degree.
        luminance: (N, 1, 1, 1), mean adapting luminance of each image in cd/m2.
        padding: (N, 1, 1, 1), value around the band.
    """
    height, width = size = base.shape[-2:]
    field = (2 * height, 2 * width)
    passed = sensitivity(frequencies(base, field, 2 * math.sqrt(2) * rho), luminance.log10())
    return upper_left(spectrum(base - padding, field) * passed, field, size)
