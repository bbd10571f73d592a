"""The mask's image is blurred, the scene is not."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskBlur
from tests.encoder.effects.conftest import seen


def test_squares_blurred_and_collected() -> None:
    pattern = torch.zeros(2, 9, 9)
    pattern[0, 4, 4] = 1
    result = seen(MaskBlur(sigma=0.8), pattern)
    assert result.sum() == pytest.approx(1, abs=1e-3)
    across = result.sum(0)
    spread = float((across * (torch.arange(9) - 4) ** 2).sum())
    assert spread == pytest.approx(0.8**2 + 2 / 12, rel=1e-2)  # of the blur, a mirror and a pixel
    torch.testing.assert_close(result, result.T)


def test_the_scene_stays_sharp() -> None:
    scene = torch.rand(2, 9, 9)
    even = torch.full((2, 9, 9), 0.5)
    result = seen(MaskBlur(sigma=0.8), even, scene)[4, 4]
    assert result == pytest.approx(float(scene[:, 4, 4].sum() / 2), abs=1e-3)
