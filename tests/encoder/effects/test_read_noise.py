"""Gaussian noise in DN of the sensor."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import ReadNoise
from tests.encoder.effects.conftest import encoder


def test_deviation_is_in_dn() -> None:
    for bits in (8, 12):
        camera = encoder(ReadNoise(std=2.0), pattern=torch.ones(2, 300, 300) / 2, bits=bits)
        values = camera(torch.full((1, 2, 300, 300), 0.5)) * (2**bits - 1)
        assert float(values.std()) == pytest.approx((2.0**2 + 1 / 12) ** 0.5, rel=0.02)
