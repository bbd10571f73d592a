"""Does the misfit follow the edges of the image, a copy of it, or its fineness?"""

from __future__ import annotations

from collections.abc import Callable

import torch
from scipy.stats import chi2

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, Regression, judge
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

EDGE_CHANGES = ("right", "down", "turn", "larger", "wider", "skew", "blur")
"""Displacement to the right and down; what is turned clockwise, larger, wider and lower, or skewed moves by so much at
the middle of the field's edges; half the squared width of a blur."""


def mask_edges(residuals: Residuals) -> Answer:
    """Regress the residual on displacements and a blur of the mask's image, with the scene where it is."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        masks, scene = residuals.masks[observation.sequence[n]], observation.scene[n]
        return (masks.sum(0, keepdim=True) if len(scene) == 1 else masks), scene  # at rest: the masks may be added up

    return _answer(residuals, light)


def image_edges(residuals: Residuals) -> Answer:
    """Regress the residual on displacements and a blur of the whole picture."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        return (residuals.masks[observation.sequence[n]] * observation.scene[n]).sum(0, keepdim=True), torch.ones(
            1, 1, 1
        )

    return _answer(residuals, light)


def _answer(residuals: Residuals, light: Callable[[int], tuple[torch.Tensor, torch.Tensor]]) -> Answer:
    """Regress on displacements of one factor of the light.

    Args:
        residuals: of a fit.
        light: for a capture's number, fields ``(T, H, W)`` that are moved, and fields that they are multiplied with.
    """
    height, width = residuals.observation.size
    y = torch.linspace(-1, 1, height)[:, None]
    x = torch.linspace(-1, 1, width)[None]
    regression = Regression(len(EDGE_CHANGES))
    for n, residual in enumerate(residuals.scaled):
        moved, fixed = light(n)
        right, down, blur = (
            (derivative * fixed).sum(0) * residuals.sensitivity[n] * residuals.observation.aperture[n]
            for derivative in _derivatives(moved)
        )
        # what moves by (u, v) changes by u * right + v * down
        turn, larger = x * down - y * right, x * right + y * down
        wider, skew = x * right - y * down, y * right + x * down
        regression.add(torch.stack((right, down, turn, larger, wider, skew, blur)), residual)
    return regression.answer(EDGE_CHANGES, "of the edges", "pixel (blur: pixel²)")


def _derivatives(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the change of a field ``(T, H, W)`` for a pixel to the right, a pixel down, and a unit of sigma**2 / 2."""
    far = torch.nn.functional.pad(field, (1, 1, 1, 1), mode="replicate")
    left, right = far[..., 1:-1, :-2], far[..., 1:-1, 2:]
    above, below = far[..., :-2, 1:-1], far[..., 2:, 1:-1]
    return (left - right) / 2, (above - below) / 2, left + right + above + below - 4 * field


REACH = 32
"""Displacement in pixels up to which the correlation is drawn; all displacements are tested."""


def copies(residuals: Residuals) -> Answer:
    """Correlate the residual with the predicted picture over all displacements: reflections, tails, a second image.

    What is proportional to the picture itself is removed first: it is a matter of gain.
    """
    height, width = residuals.observation.size
    total, squares = torch.zeros(height, width), 0.0
    for mean, weight, residual in zip(residuals.prediction.mean, residuals.sensitivity, residuals.scaled, strict=True):
        picture = mean - mean.mean()
        size = float(picture.square().sum())
        if size == 0 or not weight.any():
            continue
        picture = picture * weight.mean()
        left = residual - residual.mean()
        left = left - picture * (left * picture).sum() / picture.square().sum()
        total += torch.fft.irfft2(torch.fft.rfft2(left) * torch.fft.rfft2(picture).conj(), s=(height, width))
        squares += float(picture.square().sum())
    scores = torch.fft.fftshift(total / max(squares, 1e-30) ** 0.5)
    top, left_edge = height // 2, width // 2
    rows = slice(max(0, top - REACH), top + REACH + 1)
    columns = slice(max(0, left_edge - REACH), left_edge + REACH + 1)
    shown = scores[rows, columns]
    up, aside = top - rows.start, left_edge - columns.start
    extent = (-aside - 0.5, shown.shape[1] - aside - 0.5, shown.shape[0] - up - 0.5, -up - 0.5)
    image = Picture("map", shown, axes=("displaced to the right (pixel)", "displaced down (pixel)"), extent=extent)
    return judge(scores, image, dependent=True)


RINGS = 16
"""Rings of spatial frequency."""


def frequency(residuals: Residuals) -> Answer:
    """Test the power of the residuals in rings of spatial frequency, which is even for noise, whatever its strength."""
    return spectrum(residuals.scaled)


def spectrum(field: torch.Tensor, rings: int = RINGS) -> Answer:
    """Test that all rings of spatial frequency have the same power (Bartlett, 1937).

    Args:
        field: ``(N, H, W)`` independent fields of variance 1.
        rings: how many.
    """
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
        torch.bincount(ring, values.flatten(), minlength=rings) for values in (power * (freedom / count), freedom)
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
