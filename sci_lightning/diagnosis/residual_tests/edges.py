"""Does the misfit sit on edges: of the mask's image, or of the whole picture on the sensor?"""

from __future__ import annotations

from collections.abc import Callable

import torch

from sci_lightning.diagnosis.residual_tests.regression import Regression
from sci_lightning.diagnosis.residual_tests.residual_test import Answer
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

NAMES = ("right", "down", "turn", "larger", "wider", "skew", "blur")
"""Displacement to the right and down; what is turned clockwise, larger, wider and lower, or skewed moves by so much at
the middle of the field's edges; half the squared width of a blur."""


def mask_edges(residuals: Residuals) -> Answer:
    """Residual against what moves or blurs the mask's image and leaves the scene where it is."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        masks, scene = residuals.masks[observation.sequence[n]], observation.scene[n]
        return (masks.sum(0, keepdim=True) if len(scene) == 1 else masks), scene  # at rest: the masks may be added up

    return _answer(residuals, light)


def image_edges(residuals: Residuals) -> Answer:
    """Residual against what moves or blurs the whole picture."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        return (residuals.masks[observation.sequence[n]] * observation.scene[n]).sum(0, keepdim=True), torch.ones(
            1, 1, 1
        )

    return _answer(residuals, light)


def _answer(residuals: Residuals, light: Callable[[int], tuple[torch.Tensor, torch.Tensor]]) -> Answer:
    """Of a function that gives fields ``(T, H, W)`` that are moved, and others that they are multiplied with."""
    height, width = residuals.observation.size
    y = torch.linspace(-1, 1, height)[:, None]
    x = torch.linspace(-1, 1, width)[None]
    found = Regression(len(NAMES))
    for n, residual in enumerate(residuals.scaled):
        moved, fixed = light(n)
        right, down, blur = (
            (each * fixed).sum(0) * residuals.sensitivity[n] * residuals.observation.aperture[n]
            for each in _derivatives(moved)
        )
        # what moves by (u, v) changes by u * right + v * down
        turn, larger = x * down - y * right, x * right + y * down
        wider, skew = x * right - y * down, y * right + x * down
        found.add(torch.stack((right, down, turn, larger, wider, skew, blur)), residual)
    return found.answer(NAMES, "of the edges", "pixel (blur: pixel²)")


def _derivatives(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """What a field ``(T, H, W)`` changes by when it moves right or down by a pixel, or per unit of sigma**2 / 2."""
    far = torch.nn.functional.pad(field, (1, 1, 1, 1), mode="replicate")
    left, right = far[..., 1:-1, :-2], far[..., 1:-1, 2:]
    above, below = far[..., :-2, 1:-1], far[..., 2:, 1:-1]
    return (left - right) / 2, (above - below) / 2, left + right + above + below - 4 * field
