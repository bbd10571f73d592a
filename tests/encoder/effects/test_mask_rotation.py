"""The mask's image turns about the middle, clockwise on the screen."""

from __future__ import annotations

import math

import pytest
import torch

from sci_lightning.encoder.effects import MaskRotation
from tests.encoder.effects.conftest import seen


def dot(row: int, column: int, size: int = 9) -> torch.Tensor:
    """One open mirror, in one of two slots."""
    pattern = torch.zeros(2, size, size)
    pattern[0, row, column] = 1
    return pattern


def test_clockwise_on_the_screen() -> None:
    right = seen(MaskRotation(angle=30.0), dot(4, 8))  # from the right of the middle: down
    y, x = (right * torch.arange(9.0)[:, None]).sum() / right.sum(), (right * torch.arange(9.0)).sum() / right.sum()
    assert y - 4 == pytest.approx(4 * math.sin(math.radians(30)), abs=0.1)
    assert x - 4 == pytest.approx(4 * math.cos(math.radians(30)), abs=0.1)
    middle = seen(MaskRotation(angle=-40.0), dot(4, 4))
    assert middle.argmax() == 4 * 9 + 4
