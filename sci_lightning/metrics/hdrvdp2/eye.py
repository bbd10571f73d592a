"""From pixel values to neurons: the display, the eye's optics, its photoreceptors and its contrast sensitivity."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from sci_lightning.metrics.hdrvdp2.transforms import (
    frequencies,
    log_luminances,
    look_up,
    precomputed,
    spectrum,
    upper_left,
)

BLACK, RANGE = 1.0, 99.0
"""Luminance of the modelled display at pixel value 0, and the difference to that at 1, in cd/m2."""

D65 = ((0.601847152244699, 0.31670829557916946, 0.9046706545995032),)
CCFL_LCD = (
    (0.1989961203379287, 0.04100586040758893, 0.01437736862111919),
    (0.40476260703812544, 0.25492330644134564, 0.4809208410841319),
    (0.05439061925532116, 0.050012248959300676, 0.45427589566935994),
)
"""Light that L cones, M cones and rods absorb of every channel: cone sensitivities of Smith and Pokorny (1975) and the
CIE's scotopic one (1951) times the emission, integrated from 360 to 780 nm. S cones are not part of the model."""


def _luma(x: torch.Tensor) -> torch.Tensor:
    return RANGE * x**2.2 + BLACK


def _srgb(x: torch.Tensor) -> torch.Tensor:
    return RANGE * torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) + BLACK


def _as_given(x: torch.Tensor) -> torch.Tensor:
    return x


@dataclass(frozen=True)
class Display:
    """A display: ``luminance`` turns pixel values into cd/m2, ``matrix`` turns channels into L, M and rod light."""

    luminance: Callable[[torch.Tensor], torch.Tensor]
    matrix: tuple[tuple[float, float, float], ...]

    def receptors(self, light: torch.Tensor) -> torch.Tensor:
        """Return the light on L cones, M cones and rods, (N, 3, H, W), from that on the retina, (N, C, H, W).

        A single channel stands for equal values of all channels of the display.
        """
        matrix = _matrix(light, self.matrix)
        if light.shape[1] == 1:
            return light * matrix.sum(0)[:, None, None]
        return torch.einsum("nchw,cr->nrhw", light, matrix)


DISPLAYS = {
    "luma-display": Display(_luma, D65),
    "sRGB-display": Display(_srgb, CCFL_LCD),
    "luminance": Display(_as_given, D65),
}
"""Displays by the encoding of their pixel values."""


@precomputed
def _matrix(rows: tuple[tuple[float, float, float], ...]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)


SURROUND = 1e-5
"""Luminance around the image, cd/m2."""

SHARE, DECAY = 0.99727370023777070, (0.028, 0.37, 37.0, 360.0)
GLARE_SHARE = 0.061466549455263
WEIGHTS = (0.426 * SHARE, 0.574 * SHARE, (1 - SHARE) * GLARE_SHARE, (1 - SHARE) * (1 - GLARE_SHARE))


def scatter(luminance: torch.Tensor, pixels_per_degree: float) -> torch.Tensor:
    """Return luminance in cd/m2, (N, C, H, W), after scattering in the eye; the surround of the image is dark."""
    height, width = size = luminance.shape[-2:]
    field = (2 * height, 2 * width)
    light = spectrum(luminance - SURROUND, field) * modulation_transfer(luminance, field, pixels_per_degree)
    return (SURROUND + upper_left(light, field, size)).clamp(1e-5, 1e10)


@precomputed
def modulation_transfer(field: tuple[int, int], pixels_per_degree: float) -> torch.Tensor:
    """Return ``sum_k a_k exp(-b_k rho)``, rho in cycles per degree: 1 at 0, so that a uniform field is unchanged."""
    rho = frequencies(torch.zeros((), dtype=torch.float64), field, pixels_per_degree)
    return torch.stack([a * torch.exp(-b * rho) for a, b in zip(WEIGHTS, DECAY, strict=True)]).sum(0)


RESPONSE_POINTS = 2048
"""Luminances in the table of a photoreceptor's response."""
CORRECTION = 0.006894596 / 10**-2.4
"""Factor from the thresholds of the sensitivities below to those of the fitted metric."""


def respond(receptors: torch.Tensor) -> torch.Tensor:
    """Return the achromatic response (N, H, W), of mean 0, to the light on L cones, M cones and rods (N, 3, H, W)."""
    log_light = receptors.clamp(1e-5, 1e5).log10()
    cones = look_up(response(receptors, "cone"), log_light[:, :2]).sum(1)
    rods = look_up(response(receptors, "rod"), log_light[:, 2])
    total = cones + rods
    return total - total.mean((-2, -1), keepdim=True)


@precomputed
def response(kind: str) -> torch.Tensor:
    """Return the integral over log luminance of the sensitivity of a ``cone`` or a ``rod``, a table."""
    log_light = log_luminances(RESPONSE_POINTS)
    slope = (cone_sensitivity if kind == "cone" else rod_sensitivity)(10**log_light)
    steps = torch.cumulative_trapezoid(slope * math.log(10), log_light)
    return CORRECTION * torch.cat((torch.zeros(1, dtype=torch.float64), steps))


def joint_sensitivity(light: torch.Tensor) -> torch.Tensor:
    """Return the joint sensitivity of cones and rods: the inverse threshold contrast at a luminance (cd/m2)."""
    return 30.162 * ((4.0627 / light) ** 1.6596 + 1) ** -0.2712


def rod_sensitivity(light: torch.Tensor) -> torch.Tensor:
    """Return the sensitivity of the rods, which is highest at 1.1732 cd/m2."""
    away = (light / 1.1732).log10()
    bright, dark = away.abs() ** 2.9899 / 0.5547, away.abs() ** 1.2167 / 1.1478
    return 10**1.1414 * torch.exp(-torch.where(away > 0, bright, dark))


def cone_sensitivity(light: torch.Tensor) -> torch.Tensor:
    """Return the sensitivity of L or M cones: half of the joint one without the rods, at twice the light.

    It is interpolated between the given points of ``light``, which rise.
    """
    left = (joint_sensitivity(light) - rod_sensitivity(light)).clamp(min=1e-3)
    double = (2 * light).clamp(max=light[-1])
    above = torch.searchsorted(light, double).clamp(1, len(light) - 1)
    part = (double - light[above - 1]) / (light[above] - light[above - 1])
    return 0.5 * torch.lerp(left[above - 1], left[above], part)


SENSITIVITY_POINTS = 256
"""Luminances in the table of the contrast sensitivity in a band."""
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
    return sensitivity(torch.tensor(rho, dtype=torch.float64), log_luminances(SENSITIVITY_POINTS))


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
