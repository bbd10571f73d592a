"""The image of a square is a trapezium, by perspective."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskKeystone
from tests.encoder.effects.conftest import seen


def test_formula() -> None:
    """The mirror that is seen at (x, y) is the one at (x, y) / (1 + 2 tilt_x x / W + 2 tilt_y y / H)."""
    pattern = torch.zeros(2, 41, 41)
    pattern[0, 20, 32] = 1
    result = seen(MaskKeystone(tilt_x=0.1), pattern)
    place = (result.sum(0) * (torch.arange(41.0) - 20)).sum() / result.sum()
    assert float(place) == pytest.approx(12 / (1 - 0.1 * 12 / 20.5), abs=0.03)
    corner = torch.zeros(2, 41, 41)
    corner[0, 30, 30] = 1
    lower = seen(MaskKeystone(tilt_y=0.2), corner)
    down = (lower.sum(1) * (torch.arange(41.0) - 20)).sum() / lower.sum()
    across = (lower.sum(0) * (torch.arange(41.0) - 20)).sum() / lower.sum()
    expected = 10 / (1 - 0.2 * 10 / 20.5)
    assert (float(down), float(across)) == pytest.approx((expected, expected), abs=0.08)
    even = seen(MaskKeystone(tilt_x=0.1, tilt_y=-0.05), torch.full((2, 41, 41), 0.5))[8:33, 8:33]
    torch.testing.assert_close(even, torch.ones_like(even), atol=1e-5, rtol=0)
