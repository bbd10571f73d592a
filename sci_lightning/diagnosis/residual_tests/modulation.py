"""Does the misfit follow what single slots let through, or patterns other than those told?"""

from __future__ import annotations

from collections.abc import Callable

import torch

from sci_lightning.diagnosis.residual_tests.regression import Regression
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge

MOST_LATE = 8
"""Slots by which patterns are looked for behind their time."""


def slots(residuals: Residuals) -> Answer:
    """Residual against the light of each slot, without what all slots have in common, which is no matter of slots."""
    observation = residuals.observation
    found = Regression(observation.frames)
    for n, scene in enumerate(observation.scene):
        light = residuals.masks[observation.sequence[n]] * scene * observation.aperture[n] * residuals.sensitivity[n]
        found.add(light, residuals.scaled[n])
    names = tuple(str(slot + 1) for slot in range(observation.frames))
    return found.centred().answer(names, "slot", "part of the slot's light")


def delays(residuals: Residuals) -> Answer:
    """Residual against what changes of a moving scene when patterns come late, or stay on, by 0, 1, .. slots."""
    observation = residuals.observation
    late = min(observation.frames, MOST_LATE)
    found = Regression(late)
    for n, scene in enumerate(observation.scene):
        if len(scene) > 1:
            motion = scene - scene.mean(0)
            shown = residuals.masks[observation.sequence[n]]
            light = torch.stack([(shown.roll(each, 0) * motion).sum(0) for each in range(late)])
            found.add(light * observation.aperture[n] * residuals.sensitivity[n], residuals.scaled[n])
    return found.answer(tuple(map(str, range(late))), "slots late", "part of the light")


def patterns(residuals: Residuals) -> Answer:
    """Residual against every pattern's image for the light of the time when a pattern is told."""
    return _answer(residuals, lambda scene: scene)


def swaps(residuals: Residuals) -> Answer:
    """The same for what changes of a moving scene, which tells apart at which time a pattern is displayed."""
    return _answer(residuals, lambda scene: scene - scene.mean(0))


def _answer(residuals: Residuals, part: Callable[[torch.Tensor], torch.Tensor]) -> Answer:
    """Of a part of the scene: scores of every pattern displayed (column) while a pattern is told (row)."""
    observation, images = residuals.observation, residuals.images.flatten(1)
    count, size = len(images), residuals.raw.shape[1:]
    total = torch.zeros(count, count, dtype=torch.float64)
    squares = torch.zeros_like(total)
    for n, scene in enumerate(observation.scene):
        told = observation.sequences[observation.sequence[n]]
        shone = torch.zeros(count, *size).index_add_(0, told, part(scene).expand(len(told), *size).contiguous())
        shone = shone[used := told.unique()]
        pull = (shone * observation.aperture[n] * residuals.sensitivity[n] * residuals.scaled[n]).flatten(1)
        total[used] += (pull @ images.T).double()
        squares[used] += (pull.square() @ images.square().T).double()
    scores = torch.where(squares > 0, total / squares.sqrt(), torch.nan)
    picture = Picture("map", scores, axes=("pattern that light came through", "pattern told"))
    return judge(scores, picture, dependent=True)
