"""Light is lost with the radius squared, measured at the centre of the corner pixel."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import Vignetting
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    result = seen(Vignetting(strength=0.3), torch.full((2, 3, 5), 0.5))
    assert result[1, 2] == 1
    assert float(result[0, 0]) == float(result[2, 4]) == pytest.approx(0.7)
    assert float(result[1, 0]) == pytest.approx(1 - 0.3 * 4 / 5)


def test_undone() -> None:
    light = torch.rand(1, 3, 5)
    camera = encoder(Vignetting(strength=0.3), pattern=torch.ones(2, 3, 5))
    torch.testing.assert_close(camera.linearise(camera(light.expand(2, 3, 5)[None] / 2)), light)
