"""The variance is the light over the full well."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import ShotNoise
from tests.encoder.effects.conftest import encoder


def test_variance() -> None:
    camera = encoder(ShotNoise(full_well=1000.0), pattern=torch.ones(2, 300, 300) / 2)
    for level in (0.05, 0.5):
        values = camera(torch.full((1, 2, 300, 300), level))
        assert float(values.mean()) == pytest.approx(level, abs=3e-4)
        assert float(values.var()) == pytest.approx(level / 1000, rel=0.03)
    assert float(camera(torch.zeros(1, 2, 300, 300)).abs().max()) == 0
