"""Mirrors with gaps: nothing where they should be, less mixing where they are displaced."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import FillFactor, MaskRotation, MaskShift
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.modulator_grid import ModulatorGrid

PATTERNS = torch.rand(3, 18, 20, generator=torch.Generator().manual_seed(1))
FRACTION = 0.81  # mirrors of 0.9 of their pitch


def test_a_pixel_per_mirror_sees_no_gap() -> None:
    torch.testing.assert_close(LightPath([FillFactor(fraction=FRACTION)]).transmittance(PATTERNS), PATTERNS)


@pytest.mark.parametrize("dx", [0.04, 0.3])
def test_a_displacement_smaller_than_half_a_gap_does_nothing(dx: float) -> None:
    image = LightPath([MaskShift(dx=dx, dy=0.0), FillFactor(fraction=FRACTION)]).transmittance(PATTERNS)
    part = max(dx - 0.05, 0) / 0.9
    expected = (1 - part) * PATTERNS[..., 1:] + part * PATTERNS[..., :-1]
    torch.testing.assert_close(image[..., 1:], expected, rtol=0, atol=2e-6)


def test_a_turned_image_is_the_same_on_a_grid_of_mirrors() -> None:
    effects = [MaskRotation(angle=1.0), FillFactor(fraction=FRACTION)]
    grid = ModulatorGrid([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (18, 20), (18, 20))
    ours, other = LightPath(effects).transmittance(PATTERNS), LightPath(effects, grid).transmittance(PATTERNS)
    torch.testing.assert_close(ours, other, rtol=0, atol=0.02)
    assert float((ours - LightPath(effects[:1]).transmittance(PATTERNS)).abs().max()) > 0.03
