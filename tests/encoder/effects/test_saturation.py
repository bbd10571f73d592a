"""What is beyond the level is lost, and its noise with it."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import Saturation
from sci_lightning.encoder.signal import Signal
from tests.encoder.effects.conftest import seen


def test_formula() -> None:
    told = torch.tensor([[0.1, 0.3, 0.39, 0.41, 0.9], [0.0] * 5])[:, None]
    torch.testing.assert_close(seen(Saturation(level=0.4), told)[0], told[0, 0].clamp(max=0.4), rtol=0, atol=1e-5)


def test_noise_of_a_clipped_gaussian() -> None:
    level, deviation = 0.4, 0.02
    for mean in (0.2, 0.37, 0.4, 0.42, 0.6):
        light = torch.full((1, 1000, 1000), mean)
        signal = Signal(light, torch.tensor(deviation**2), torch.ones(1, 1, 1), 1 / 255, (0, 0), (1000, 1000))
        result = Saturation(level=level).respond(signal)
        drawn = (light + deviation * torch.randn_like(light)).clamp(max=level)
        assert float(result.mean[0, 0, 0]) == pytest.approx(float(drawn.mean()), abs=1e-4)
        assert float(result.variance.expand(1, 1000, 1000)[0, 0, 0]) == pytest.approx(float(drawn.var()), rel=0.02)


def test_no_noise_comes_from_rounding() -> None:
    signal = Signal(torch.rand(1, 99, 99), torch.zeros(()), torch.ones(1, 1, 1), 1 / 255, (0, 0), (99, 99))
    assert float(Saturation(level=0.5).respond(signal).variance.max()) < 1e-11
