"""The same offset everywhere; a negative one clips the dark."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import BlackLevel
from tests.encoder.effects.conftest import encoder, seen

GREY = torch.full((2, 2, 2), 0.25)  # 0.5 in all


def test_formula() -> None:
    assert float(seen(BlackLevel(offset=0.1), GREY)[0, 0]) == pytest.approx(0.6)
    dark = encoder(BlackLevel(offset=-0.1), pattern=GREY, bits=8)
    assert not dark(torch.full((1, 2, 2, 2), 0.1)).any()
    camera = encoder(BlackLevel(offset=0.1), pattern=GREY)
    assert float(camera.linearise(torch.full((1, 2, 2), 0.6))[0, 0, 0]) == pytest.approx(0.5)
