"""What is far from the middle moves with the cube of its distance; nothing is lost inside."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskDistortion
from tests.encoder.effects.conftest import seen


@pytest.mark.parametrize("k", [-0.1, 0.1])
def test_formula(k: float) -> None:
    """A mirror at (x, 0) is seen at x (1 + k x^2 / R^2)."""
    pattern = torch.zeros(2, 41, 41)
    pattern[0, 20, 36] = 1
    result = seen(MaskDistortion(k=k), pattern)
    place = (result.sum(0) * (torch.arange(41.0) - 20)).sum() / result.sum()
    assert float(place) == pytest.approx(16 * (1 + k * 16**2 / (2 * 20.5**2)), abs=0.02)
    middle = torch.zeros(2, 41, 41)
    middle[0, 20, 20] = 1
    torch.testing.assert_close(seen(MaskDistortion(k=k), middle)[20, 20], torch.tensor(1.0), atol=1e-3, rtol=0)
    even = seen(MaskDistortion(k=k), torch.full((2, 41, 41), 0.5))[15:26, 15:26]
    torch.testing.assert_close(even, torch.ones_like(even), atol=1e-5, rtol=0)
