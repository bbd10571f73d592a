"""Blocks of the modulator's rows change one after the other; what is late shows the pattern before, cyclically."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskContrast, MaskOrientation, MaskShift, PhasedReset
from sci_lightning.encoder.effects.exposure.phased_reset import BLOCKS
from sci_lightning.encoder.light_path import LightPath
from tests.encoder.effects.conftest import seen

DELAY = 0.3
LATE = DELAY * torch.arange(BLOCKS) / (BLOCKS - 1)


def patterns(height: int = BLOCKS) -> torch.Tensor:
    return torch.rand(4, height, 16, generator=torch.Generator().manual_seed(1))


def test_formula() -> None:
    told, late = patterns(), LATE[:, None]
    scene = torch.rand(4, BLOCKS, 16, generator=torch.Generator().manual_seed(2))
    expected = (((1 - late) * told + late * told.roll(1, 0)) * scene).sum(0)
    torch.testing.assert_close(seen(PhasedReset(delay=DELAY), told, scene), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("height", [12, 40])
def test_blocks_of_other_heights(height: int) -> None:
    told = torch.zeros(2, height, 3)
    told[1] = 1
    shown = LightPath([PhasedReset(delay=0.3)]).transmittance(told)[0, :, 0]
    torch.testing.assert_close(shown, LATE[torch.arange(height) * BLOCKS // height])


def test_the_blocks_are_those_of_the_modulator() -> None:
    """They move along with the mask's image, are turned with it, and leak as all mirrors do."""
    told = patterns()
    others = [MaskShift(dx=0.0, dy=2.0), MaskOrientation(operation="flip_ud"), MaskContrast(leak=0.1)]
    by_hand = (1 - LATE[:, None]) * told + LATE[:, None] * told.roll(1, 0)
    expected = LightPath(others).transmittance(by_hand)
    together = LightPath([*others, PhasedReset(delay=DELAY)]).transmittance(told)
    torch.testing.assert_close(together, expected, rtol=0, atol=1e-6)
