"""The mean of two images of the mask, one of them larger, the other one smaller."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import LateralColour, MaskRotation, MaskScale
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.modulator_grid import ModulatorGrid

PATTERNS = torch.rand(3, 20, 24, generator=torch.Generator().manual_seed(1))
GRID = ModulatorGrid([[0.9, 0, 0.5], [0, 0.9, 0.3], [0, 0, 1]], (18, 20), (20, 24))


@pytest.mark.parametrize("grid", [None, GRID], ids=["pixels", "mirrors"])
def test_two_colours(grid: ModulatorGrid | None) -> None:
    others = [MaskRotation(angle=1.0)]
    colours = [
        LightPath([*others, MaskScale(scale=1.01 * part)], grid).transmittance(PATTERNS) for part in (1.03, 0.97)
    ]
    path = LightPath([*others, MaskScale(scale=1.01), LateralColour(spread=0.03)], grid)
    torch.testing.assert_close(path.transmittance(PATTERNS), sum(colours) / 2, rtol=0, atol=1e-6)


def test_the_smaller_colour_leaves_a_border() -> None:
    border = LightPath([LateralColour(spread=0.05)]).border((40, 60))
    assert (border.top, border.left) == pytest.approx((1.0, 1.5))
    assert LightPath([LateralColour(spread=0.05)], GRID).border((18, 20)).contains(LightPath([], GRID).border((18, 20)))
