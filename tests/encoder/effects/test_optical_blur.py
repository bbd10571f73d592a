"""The modulated image is blurred; beyond the field it is dark."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import OpticalBlur
from tests.encoder.effects.conftest import seen


def test_pixels_blurred_and_collected() -> None:
    pattern = torch.zeros(2, 11, 11)
    pattern[0, 5, 5] = 1
    result = seen(OpticalBlur(sigma=0.7), pattern)
    assert result.sum() == pytest.approx(1, abs=1e-3)
    spread = float((result.sum(0) * (torch.arange(11) - 5) ** 2).sum())
    assert spread == pytest.approx(0.7**2 + 2 / 12, rel=1e-2)


def test_it_blurs_the_scene_too_and_ends_in_the_dark() -> None:
    scene = torch.zeros(2, 11, 11)
    scene[:, 5, 5] = 1
    assert seen(OpticalBlur(sigma=0.7), torch.ones(2, 11, 11) / 2, scene)[5, 6] > 0.1
    edge = seen(OpticalBlur(sigma=0.7), torch.ones(2, 11, 11) / 2)
    assert edge[5, 5] == pytest.approx(1, abs=1e-3) and edge[5, 0] < 0.8
