"""Offsets of rows, the same in every capture."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import RowNoise
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    effect = RowNoise(size=(5, 6), std=0.02)
    assert effect.map.shape == (5, 1) and float(effect.map.std()) == pytest.approx(1)
    result = seen(effect, torch.full((2, 5, 6), 0.25))
    torch.testing.assert_close(result, 0.5 + 0.02 * effect.map.expand(5, 6))
    camera = encoder(effect, pattern=torch.full((2, 5, 6), 0.25))
    torch.testing.assert_close(camera.linearise(result[None]), torch.full((1, 5, 6), 0.5))
