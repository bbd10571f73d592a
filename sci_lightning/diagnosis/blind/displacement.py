"""Where a far displacement of the mask's image is looked for in snapshots: by correlation, everywhere at once.

A mask of independent mirrors looks like no copy of itself that is displaced by more than a mirror, so that the
likelihood leads to a displacement from its neighbourhood alone. Scenes are smooth where masks are not: what a snapshot
has of fine detail comes from the sum of the patterns, wherever that lies.

At the edge of a large field a small rotation displaces the image by a pixel or more. A displacement by itself then fits
a part of the field only, and so does a rotation: neither leads to the other. What is fine in the snapshots is
correlated with the patterns' sum part by part, and the displacements of the parts tell both. A small field is one part,
which tells the displacement alone.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional as F

from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.search.displacement import displacing_effects, on_all_sides, starts_at

NEIGHBOURHOOD_PX = 9
"""Side in pixels of the square over which a mean is taken: what differs from it counts as fine detail."""
LEAST_CONTRAST = 0.02
"""Fine detail of the sum of the patterns, over its mean, below which there is nothing to correlate with."""
PEAKS = 2
"""Displacements by whole pixels that are proposed."""
OFF_GRID_PX = 0.5
"""Pixels from a whole number at which fits start, to all four sides: linear interpolation has a kink there."""
GRID_RADIUS_PX = 3.5
"""Pixels up to which displacements are proposed, one for every pixel, where nothing can be correlated."""
PART_PX = 64
"""Side in pixels of a part of the field; a field that has not two of them along either side is one part."""
PART_SEARCH_PX = 4
"""Pixels around the displacement of the whole field by which a part may be displaced."""
CLEAR_SIGMA = 5.0
"""Standard deviations by which the correlation of a part must differ from chance to count."""
LEAST_PARTS = 4
"""Parts with a clear displacement that tell how the displacement changes over the field."""
POSE_SIGMA = 4.0
"""Standard errors by which a rotation or a magnification must differ from none."""


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
        steps = (torch.arange(2 * GRID_RADIUS_PX + 1) - GRID_RADIUS_PX).tolist()
        displacements = [(dx, dy) for dy in steps for dx in steps]
    else:
        displacements = on_all_sides(peaks, OFF_GRID_PX)
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
    half = NEIGHBOURHOOD_PX // 2
    padded = F.pad(images[:, None], (half,) * 4, mode="reflect")
    mean = F.avg_pool2d(padded, NEIGHBOURHOOD_PX, stride=1)[:, 0]
    least = 1e-3 * mean.amax((1, 2), keepdim=True).clamp(min=1e-12)
    return (images / torch.maximum(mean, least) - 1).clamp(-1, 1)


def first_pose(likelihood: BlindLikelihood, hypothesis: Hypothesis, border_share: float) -> dict[str, Setting]:
    """Return settings of effects that displace the mask's image as parts of the field show it.

    The displacement at (x, y) from the field's centre is (dx - angle y + s x, dy + angle x + s y) for a small rotation
    and a magnification of 1 + s. They are fitted by least squares.

    Args:
        likelihood: knows the snapshots.
        hypothesis: without a displacement, whose image of the patterns is displaced.
        border_share: largest part of the field by which the image may be displaced.

    Returns:
        A displacement, and what changes over the field by :data:`POSE_SIGMA` standard errors; {} where
        too few parts are clearly displaced.
    """
    whole = correlated_displacements(likelihood, hypothesis, border_share)
    if not whole:
        return {}
    shortest = min(likelihood.model.observation.size)
    part = PART_PX if shortest >= 2 * PART_PX else shortest
    place, moved, weight = _parts(likelihood, hypothesis, whole[0], part)
    if part == shortest and len(place):
        dx, dy = (moved * weight[:, None]).sum(0).div(weight.sum()).tolist()
        return {"mask_shift": {"dx": dx, "dy": dy}}
    if len(place) < LEAST_PARTS:
        return {}
    x, y = place.T
    one, none = torch.ones_like(x), torch.zeros_like(x)
    design = torch.stack([torch.cat(both) for both in ((one, none), (none, one), (-y, x), (x, y))], 1)
    design, target = design * weight.repeat(2)[:, None], moved.T.flatten() * weight.repeat(2)
    fitted = torch.linalg.lstsq(design, target[:, None]).solution[:, 0]
    variance = (target - design @ fitted).square().sum() / (len(target) - len(fitted))
    errors = (variance * torch.linalg.inv(design.mT @ design).diagonal()).sqrt()
    dx, dy, angle, more = fitted.tolist()
    pose: dict[str, Setting] = {"mask_shift": {"dx": dx, "dy": dy}}
    turned, magnified = (fitted[2:].abs() > POSE_SIGMA * errors[2:]).tolist()
    if turned:
        pose["mask_rotation"] = {"angle": math.degrees(angle)}
    if magnified:
        pose["mask_scale"] = {"scale": 1 + more}
    return pose


def _parts(
    likelihood: BlindLikelihood, hypothesis: Hypothesis, about: tuple[float, float], part: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return place ``(P, 2)``, displacement ``(P, 2)`` and weight ``(P,)`` of the parts that are clearly displaced.

    Places are (x, y) of the parts' middles in pixels from the field's centre, displacements (dx, dy) in pixels.

    Args:
        likelihood, hypothesis: as in :func:`first_pose`.
        about: displacement of the whole field.
        part: side of a part in pixels.
    """
    observation = likelihood.model.observation
    height, width = observation.size
    first = tuple(round(value) for value in about)
    steps = range(-PART_SEARCH_PX, PART_SEARCH_PX + 1)
    room = PART_SEARCH_PX + max(abs(value) for value in first)
    product = torch.zeros(len(steps), len(steps), height // part, width // part, dtype=torch.float64)
    power = torch.zeros_like(product)

    def pooled(field: torch.Tensor) -> torch.Tensor:
        return F.avg_pool2d(field[None], part)[0] * part**2

    for which, sequence in enumerate(observation.sequences):
        pattern = fine_detail(likelihood.relative_mask(hypothesis, sequence).sum(0)[None])[0]
        padded = F.pad(pattern, (room,) * 4)
        for seen in fine_detail(observation.dn[observation.sequence == which].double()):
            squared = pooled(seen.square())
            for i, down in enumerate(steps):
                for j, across in enumerate(steps):
                    top, left = room - first[1] - down, room - first[0] - across
                    there = padded[top : top + height, left : left + width]
                    product[i, j] += pooled(seen * there)
                    power[i, j] += (squared * pooled(there.square())).clamp(min=1e-12).sqrt()
    evidence = (product / power * part).flatten(2).movedim(2, 0)  # (parts, down, across)
    places, moved, weights = [], [], []
    for number, there in enumerate(evidence):
        peak = int(there.argmax())
        i, j = divmod(peak, len(steps))
        height_of_peak = float(there[i, j])
        if height_of_peak < CLEAR_SIGMA or not (0 < i < len(steps) - 1 and 0 < j < len(steps) - 1):
            continue
        row, column = divmod(number, width // part)
        places.append([(column + 0.5) * part - width / 2, (row + 0.5) * part - height / 2])
        fine = [_vertex(there[i, j - 1 : j + 2]), _vertex(there[i - 1 : i + 2, j])]
        moved.append([first[0] + j - PART_SEARCH_PX + fine[0], first[1] + i - PART_SEARCH_PX + fine[1]])
        weights.append(height_of_peak)
    return (
        torch.tensor(places, dtype=torch.float64).reshape(-1, 2),
        torch.tensor(moved, dtype=torch.float64).reshape(-1, 2),
        torch.tensor(weights, dtype=torch.float64),
    )


def _vertex(three: torch.Tensor) -> float:
    """Return where the parabola through three values at -1, 0 and 1, of which the middle one is the largest, peaks."""
    before, middle, after = three.tolist()
    curvature = before - 2 * middle + after
    return 0.0 if curvature >= 0 else 0.5 * (before - after) / curvature
