"""Shown = told ** gamma; binary masks do not show it."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import MaskLevelGamma
from tests.encoder.effects.conftest import seen


def test_formula() -> None:
    told = torch.tensor([[0.0, 0.5, 1.0], [0.0, 0.25, 0.0]])[:, None]
    result = seen(MaskLevelGamma(gamma=2.0), told)[0]
    torch.testing.assert_close(result, torch.tensor([0.0, 0.25 + 0.0625, 1.0]))
