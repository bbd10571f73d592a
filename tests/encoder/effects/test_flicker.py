"""Every slot collects the integral of 1 + A sin(2 pi f s / T + phase)."""

from __future__ import annotations

import math

import pytest
import torch

from sci_lightning.encoder.effects import Flicker
from tests.encoder.effects.conftest import seen


def power(effect: Flicker) -> list[float]:
    open_ = torch.ones(4, 2, 2)
    return [float(seen(effect, open_, light[:, None, None].expand(4, 2, 2))[0, 0]) for light in torch.eye(4)]


def test_integral() -> None:
    effect = Flicker(amplitude=0.2, frequency=1.7, phase=0.4)
    rate = 2 * math.pi * 1.7 / 4

    def integral(s: float) -> float:
        return s - 0.2 * math.cos(rate * s + 0.4) / rate

    assert power(effect) == pytest.approx([integral(s + 1) - integral(s) for s in range(4)], abs=1e-5)


def test_fast_flicker_averages_out() -> None:
    for cycles in (32.0, 64.0):  # a whole number in every step of a slot
        assert power(Flicker(amplitude=0.5, frequency=cycles, phase=1.0)) == pytest.approx([1.0] * 4, abs=1e-5)
