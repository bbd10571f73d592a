"""Does the misfit follow what single slots let through, or patterns other than the commanded ones?"""

from __future__ import annotations

from collections.abc import Callable

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, Regression, judge
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

MOST_LATE = 8
"""Delay in slots up to which patterns are looked for."""


def slots(residuals: Residuals) -> Answer:
    """Regress the residual on the light of every slot, without what all slots have in common."""
    observation = residuals.observation
    regression = Regression(observation.frames)
    for n, scene in enumerate(observation.scene):
        light = residuals.masks[observation.sequence[n]] * scene * observation.aperture[n] * residuals.sensitivity[n]
        regression.add(light, residuals.scaled[n])
    names = tuple(str(slot + 1) for slot in range(observation.frames))
    return regression.centred().answer(names, "slot", "part of the slot's light")


def delays(residuals: Residuals) -> Answer:
    """Regress the residual on the change of a moving scene when patterns come late, or stay on, by 0, 1, .. slots."""
    observation = residuals.observation
    late = min(observation.frames, MOST_LATE)
    regression = Regression(late)
    for n, scene in enumerate(observation.scene):
        if len(scene) > 1:
            motion = scene - scene.mean(0)
            shown = residuals.masks[observation.sequence[n]]
            light = torch.stack([(shown.roll(delay, 0) * motion).sum(0) for delay in range(late)])
            regression.add(light * observation.aperture[n] * residuals.sensitivity[n], residuals.scaled[n])
    return regression.answer(tuple(map(str, range(late))), "slots late", "part of the light")


def patterns(residuals: Residuals) -> Answer:
    """Regress the residual on every pattern's image, with the light of the slots in which a pattern is commanded."""
    return _answer(residuals, lambda scene: scene)


def swaps(residuals: Residuals) -> Answer:
    """Do the same with the changing part of a moving scene, which shows in which slot a pattern is displayed."""
    return _answer(residuals, lambda scene: scene - scene.mean(0))


def _answer(residuals: Residuals, part: Callable[[torch.Tensor], torch.Tensor]) -> Answer:
    """Correlate the residual with every pattern displayed (column) while a pattern is commanded (row).

    Args:
        residuals: of a fit.
        part: of the scene ``(T, H, W)`` that is looked at.
    """
    observation, images = residuals.observation, residuals.images.flatten(1)
    count, size = len(images), residuals.raw.shape[1:]
    total = torch.zeros(count, count, dtype=torch.float64)
    squares = torch.zeros_like(total)
    for n, scene in enumerate(observation.scene):
        commanded = observation.sequences[observation.sequence[n]]
        light = part(scene).expand(len(commanded), *size).contiguous()
        shone = torch.zeros(count, *size).index_add_(0, commanded, light)
        shone = shone[used := commanded.unique()]
        product = (shone * observation.aperture[n] * residuals.sensitivity[n] * residuals.scaled[n]).flatten(1)
        total[used] += (product @ images.T).double()
        squares[used] += (product.square() @ images.square().T).double()
    scores = torch.where(squares > 0, total / squares.sqrt(), torch.nan)
    picture = Picture("map", scores, axes=("pattern that light came through", "commanded pattern"))
    return judge(scores, picture, dependent=True)
