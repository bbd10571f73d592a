"""Is the misfit coarser or finer than noise?"""

from __future__ import annotations

import torch
from scipy.stats import chi2

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

RINGS = 16
"""Rings of spatial frequency."""


def frequency(residuals: Residuals) -> Answer:
    """Power of the residuals in rings of spatial frequency, which is even for noise, whatever its strength."""
    return spectrum(residuals.scaled)


def spectrum(field: torch.Tensor, rings: int = RINGS) -> Answer:
    """Of independent fields ``(N, H, W)`` of variance 1; Bartlett's test (1937) that all rings have the same power."""
    count, height, width = field.shape
    amplitude = torch.fft.rfft2(field)
    power = (amplitude.real.square() + amplitude.imag.square()).sum(0).double() / (height * width)
    half = torch.full((width // 2 + 1,), 2.0, dtype=torch.float64)  # stands for its mirror image too
    half[0] = 1
    if width % 2 == 0:
        half[-1] = 1
    freedom = half.expand(height, -1).clone() * count
    freedom[0, 0] = 0  # the mean is no matter of frequency
    across = torch.fft.rfftfreq(width)[None]
    down = torch.fft.fftfreq(height)[:, None]
    radius = torch.hypot(across, down).flatten()
    order = radius.argsort()
    ring = torch.empty_like(order)
    ring[order] = (freedom.flatten()[order].cumsum(0) / freedom.sum().clamp(min=1) * rings).long().clamp(max=rings - 1)
    total, size = (
        torch.bincount(ring, each.flatten(), minlength=rings) for each in (power * (freedom / count), freedom)
    )
    place = torch.bincount(ring, radius.double() * freedom.flatten(), minlength=rings) / size.clamp(min=1)
    kept = size >= 8
    total, size, place = total[kept], size[kept], place[kept]
    picture = Picture(
        "curve",
        total / size,
        unit="power (1 = noise)",
        x=tuple(place.tolist()),
        axes=("spatial frequency (cycles per pixel)",),
        errors=(2 / size).sqrt(),
        middle=1.0,
    )
    if len(size) < 2 or total.sum() <= 0:
        return Answer(0.0, 1.0, 0.0, picture)
    mean = total.sum() / size.sum()
    statistic = -float((size * (total / size / mean).clamp(min=1e-30).log()).sum())
    statistic /= float(1 + ((1 / size).sum() - 1 / size.sum()) / (3 * (len(size) - 1)))
    freedom_left = len(size) - 1
    nats = max(0.0, statistic - freedom_left) / 2
    return Answer(statistic, float(chi2.sf(statistic, freedom_left)), nats, picture)
