"""Less light from every slot; under steady light nothing else."""

from __future__ import annotations

import math

import pytest
import torch

from sci_lightning.encoder.effects import DutyCycle, Flicker
from sci_lightning.encoder.exposure import Exposure


@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.93])
def test_formula(fraction: float) -> None:
    exposed = DutyCycle(fraction=fraction).expose(Exposure.ideal(4, 2, torch.zeros(1)))
    torch.testing.assert_close(exposed.mask(torch.ones(1, 4, 2, 3)), torch.full((1, 4, 2, 3), fraction))


def test_flicker_is_seen_while_a_pattern_is_shown() -> None:
    """The source is bright in the first half of every slot: a duty cycle of a half collects that half only."""
    ideal = Exposure.ideal(4, 2, torch.zeros(1))
    bright = Flicker(amplitude=0.5, frequency=4.0, phase=0.0).expose(ideal)
    collected = DutyCycle(fraction=0.5).expose(bright).mask(torch.ones(1, 4, 1, 1).expand(1, 4, 2, 1))
    torch.testing.assert_close(collected[0, :, 0, 0], torch.full((4,), 0.5 + 0.5 / math.pi), atol=1e-4, rtol=0)
