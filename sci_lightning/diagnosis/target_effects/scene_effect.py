"""The base class of the effects of the target, and how a target is resampled.

A target is a continuous picture of which the file states the means over pixels. It is resampled by cubic B-splines,
which keep its sharpness; beyond the field its edge is repeated.
"""

from __future__ import annotations

from functools import lru_cache

import torch
from torch.nn.functional import embedding_bag

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.footprint import without_negligible


class SceneEffect(Effect):
    """What the target shows, as a function of what the file says it shows; every frame by itself."""

    stage = "scene"

    def change(self, scene: torch.Tensor) -> torch.Tensor:
        """Return the scene ``(T, H, W)`` as it really is.

        Args:
            scene: irradiance; ``(T, 1, 1)`` for an even scene, ``(1, H, W)`` for one at rest.
        """
        return scene


def changed_scenes(effect: SceneEffect, scenes: list[torch.Tensor]) -> list[torch.Tensor]:
    """Return scenes changed by an effect, all frames of a shape at once.

    Splines swing below 0 beside steep edges; no target does.
    """
    changed: list[torch.Tensor] = [torch.zeros(())] * len(scenes)
    for shape in {scene.shape[1:] for scene in scenes}:
        members = [n for n, scene in enumerate(scenes) if scene.shape[1:] == shape]
        frames = effect.change(torch.cat([scenes[n] for n in members])).clamp(min=0)
        for n, part in zip(members, frames.split([len(scenes[n]) for n in members]), strict=True):
            changed[n] = part
    return changed


def resampled(scene: torch.Tensor, row: torch.Tensor, column: torch.Tensor) -> torch.Tensor:
    """Return the scene ``(T, H, W)`` at other places.

    Args:
        scene: ``(T, H, W)``.
        row, column: ``(H, 1)`` and ``(1, W)``, or ``(H, W)`` both: the places, in pixels from the first pixel's centre.
    """
    height, width = scene.shape[-2:]
    to_rows, to_columns = (_coefficients(length).to(scene) for length in (height, width))
    if row.shape[-1] == 1 and column.shape[0] == 1:
        return _weights(row[:, 0], height) @ to_rows @ scene @ (_weights(column[0], width) @ to_columns).T
    spline = (to_rows @ scene @ to_columns.T).flatten(-2)
    across = _taps(column, width)
    taps = [(line * width + place, down * over) for line, down in _taps(row, height) for place, over in across]
    index, weight = (torch.stack(part, -1).flatten(0, 1) for part in zip(*taps, strict=True))
    seen = embedding_bag(index, spline.T.contiguous(), per_sample_weights=weight, mode="sum")
    return seen.T.reshape(scene.shape)


def blurred(scene: torch.Tensor, sigma: torch.Tensor) -> torch.Tensor:
    """Return the scene ``(T, H, W)`` blurred by a Gaussian of ``sigma`` pixels; mirrored beyond the field.

    The cosine transform is multiplied by the Gaussian's own, so that any width is exact for a target without detail
    finer than the pixels.
    """
    down, across = (_gaussian(length, sigma.to(scene)) for length in scene.shape[-2:])
    return down @ scene @ across.T


def from_centre(scene: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return y ``(H, 1)`` and x ``(1, W)`` of the pixels, in pixels from the centre of the field."""
    y, x = (torch.arange(length).to(scene) - (length - 1) / 2 for length in scene.shape[-2:])
    return y[:, None], x[None]


def _gaussian(length: int, sigma: torch.Tensor) -> torch.Tensor:
    place = torch.arange(length).to(sigma)
    frequency = place * (torch.pi / length)
    cosines = torch.cos(frequency[:, None] * (place + 0.5)) * (2 / length) ** 0.5
    cosines = torch.cat((cosines[:1] * 0.5**0.5, cosines[1:]))
    return cosines.T @ (torch.exp(-0.5 * (sigma * frequency).square())[:, None] * cosines)


def _spline(distance: torch.Tensor) -> torch.Tensor:
    """Return the cubic B-spline."""
    far = distance.abs()
    return torch.where(far < 1, 2 / 3 - far.square() + 0.5 * far**3, (2 - far).clamp(min=0) ** 3 / 6)


def _taps(place: torch.Tensor, length: int) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Return (index, weight) of the four coefficients around every place."""
    place = place.clamp(0, length - 1)
    first = place.floor().long()
    return [((first + step).clamp(0, length - 1), _spline(place - (first + step))) for step in (-1, 0, 1, 2)]


def _weights(place: torch.Tensor, length: int) -> torch.Tensor:
    """Return ``(places, length)``: the weight of every coefficient at every place along one axis."""
    weights = torch.zeros(len(place), length).to(place)
    for index, weight in _taps(place, length):
        weights = weights.scatter_add(1, index[:, None], weight[:, None])
    return weights


@lru_cache(maxsize=8)
def _coefficients(length: int) -> torch.Tensor:
    """Return the matrix from values at the pixels to the spline's coefficients, float64."""
    return without_negligible(torch.linalg.inv(_weights(torch.arange(length, dtype=torch.float64), length)))
