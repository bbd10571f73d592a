"""The eye: light scattered by its optics, and the response of its photoreceptors in just-noticeable steps."""

from __future__ import annotations

import math

import torch

from sci_lightning.metrics.hdrvdp2.fourier import frequencies, spectrum, upper_left
from sci_lightning.metrics.hdrvdp2.tabulated import log_luminances, look_up, precomputed

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


POINTS = 2048
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
    """Return the integral over log luminance of the sensitivity of a ``cone`` or a ``rod``, a table of 2048 values."""
    log_light = log_luminances(POINTS)
    sensitivity = (cone_sensitivity if kind == "cone" else rod_sensitivity)(10**log_light)
    steps = torch.cumulative_trapezoid(sensitivity * math.log(10), log_light)
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
