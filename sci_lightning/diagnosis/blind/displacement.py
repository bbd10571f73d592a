"""Where a far displacement of the mask's image is looked for in snapshots: by correlation, everywhere at once.

A mask of independent mirrors looks like no copy of itself that is displaced by more than a mirror, so that the
likelihood leads to a displacement from its neighbourhood alone. Scenes are smooth where masks are not: what a snapshot
has of fine detail comes from the sum of the patterns, wherever that lies.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional as F

from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.model.camera_model import Hypothesis, Setting
from sci_lightning.diagnosis.search.displacement import displacing_effects, on_all_sides, starts_at

NEIGHBOURHOOD = 9
"""Side in pixels of the square over which a mean is taken: what differs from it counts as fine detail."""
LEAST_CONTRAST = 0.02
"""Fine detail of the sum of the patterns, over its mean, below which there is nothing to correlate with."""
PEAKS = 2
"""Displacements by whole pixels that are proposed."""
ASIDE = 0.5
"""Pixels from a whole number at which fits start, to all four sides: linear interpolation has a kink there."""
GRID = 3.5
"""Pixels up to which displacements are proposed, one for every pixel, where nothing can be correlated."""


def proposed_displacements(
    likelihood: BlindLikelihood, hypothesis: Hypothesis, border_share: float
) -> dict[str, list[Setting]]:
    """Return settings with a displacement of the mask's image from which a fit may start, by effect.

    Patterns whose sum is even (structural masks) show no displacement of the sum; a grid of displacements by a few
    pixels is proposed for them.

    Args:
        likelihood: knows the snapshots.
        hypothesis: without a displacement, whose image of the patterns is displaced.
        border_share: largest part of the field by which the image may be displaced.
    """
    model = likelihood.model
    effects = displacing_effects(model, hypothesis)
    if not effects:
        return {}
    peaks = correlated_displacements(likelihood, hypothesis, border_share)
    if peaks is None:
        steps = (torch.arange(2 * GRID + 1) - GRID).tolist()
        displacements = [(dx, dy) for dy in steps for dx in steps]
    else:
        displacements = on_all_sides(peaks, ASIDE)
    return starts_at(displacements, effects, model)


def correlated_displacements(
    likelihood: BlindLikelihood, hypothesis: Hypothesis, border_share: float
) -> list[tuple[float, float]] | None:
    """Return displacements (dx, dy) of the highest correlations in whole pixels, the highest one first.

    With the detail a of a snapshot and b of the sum of the patterns, the correlation coefficient at a displacement d is
    r(d) = sum a(x) b(x - d) / sqrt(sum a(x)^2 sum b(x - d)^2) over the overlap of n(d) pixels, and r(d)^2 n(d) / 2 nats
    speak for it.

    Args:
        likelihood: knows the snapshots.
        hypothesis: whose image of the patterns is displaced.
        border_share: largest part of the field by which the image may be displaced.

    Returns:
        None if the patterns' sum has no detail.
    """
    observation = likelihood.model.observation
    height, width = observation.size
    size = [2 * height, 2 * width]

    def spectrum(image: torch.Tensor) -> torch.Tensor:
        return torch.fft.rfft2(image, s=size)

    def correlate(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
        return torch.fft.irfft2(spectrum(first) * spectrum(second).conj(), s=size)

    ones = torch.ones(1, height, width, dtype=torch.float64)
    product, power = torch.zeros(2, *size, dtype=torch.float64)
    for which, sequence in enumerate(observation.sequences):
        pattern = fine_detail(likelihood.relative_mask(hypothesis, sequence).sum(0)[None])
        if float(pattern.square().mean().sqrt()) < LEAST_CONTRAST:
            return None
        seen = fine_detail(observation.dn[observation.sequence == which].double())
        product += correlate(seen, pattern).sum(0)
        power += (correlate(seen.square(), ones) * correlate(ones, pattern.square())).clamp(min=1e-12).sqrt().sum(0)
    overlap = correlate(ones, ones)[0].clamp(min=1.0)
    evidence = product / power * overlap.sqrt()
    down = torch.fft.fftfreq(size[0], 1 / size[0])[:, None]
    across = torch.fft.fftfreq(size[1], 1 / size[1])[None]
    possible = (down.abs() <= math.floor(border_share * height)) & (across.abs() <= math.floor(border_share * width))
    places = torch.where(possible, evidence, -torch.inf).flatten().topk(PEAKS).indices.tolist()
    return [(float(across[0, place % size[1]]), float(down[place // size[1], 0])) for place in places]


def fine_detail(images: torch.Tensor) -> torch.Tensor:
    """Return by how much images ``(N, H, W)`` differ from their local mean, relative to it, and at most by it."""
    half = NEIGHBOURHOOD // 2
    padded = F.pad(images[:, None], (half,) * 4, mode="reflect")
    mean = F.avg_pool2d(padded, NEIGHBOURHOOD, stride=1)[:, 0]
    least = 1e-3 * mean.amax((1, 2), keepdim=True).clamp(min=1e-12)
    return (images / torch.maximum(mean, least) - 1).clamp(-1, 1)
