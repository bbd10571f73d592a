"""Light times a factor; the decoder gets it divided out."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import Gain
from tests.encoder.effects.conftest import encoder, seen

GREY = torch.full((2, 2, 2), 0.25)  # 0.5 in all


def test_formula() -> None:
    assert float(seen(Gain(factor=1.2), GREY)[0, 0]) == pytest.approx(0.6)
    assert float(encoder(Gain(factor=1.2), pattern=GREY).linearise(torch.full((1, 2, 2), 0.6))[0, 0, 0]) == (
        pytest.approx(0.5)
    )
