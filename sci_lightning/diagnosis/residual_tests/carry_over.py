"""Does something of a capture remain in those that follow?"""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.regression import Regression
from sci_lightning.diagnosis.residual_tests.residual_test import Answer
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

LATER = 3
"""Captures after which something is looked for."""


def carry_over(residuals: Residuals) -> Answer:
    """Residual against the pictures of the captures before it in the file, what resembles its own picture taken out."""
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    place = {number: n for n, number in enumerate(residuals.observation.number.tolist())}
    found = Regression(LATER)
    for number, n in place.items():
        weight = residuals.sensitivity[n]
        own = torch.linalg.qr(torch.stack((weight, weight * pictures[n]), -1).flatten(0, 1)).Q
        changes = torch.zeros(LATER, *weight.shape)
        for later in range(1, LATER + 1):
            if number - later in place:
                before = (pictures[place[number - later]] * weight).flatten()
                changes[later - 1] = (before - own @ (own.T @ before)).reshape(weight.shape)
        found.add(changes, residuals.scaled[n])
    names = tuple(str(later) for later in range(1, LATER + 1))
    return found.answer(names, "captures later", "part that remains")
