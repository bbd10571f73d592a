"""Shown = leak + (1 - leak) * told."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import MaskContrast
from tests.encoder.effects.conftest import seen


def test_formula() -> None:
    told = torch.tensor([[0.0, 0.5, 1.0], [0.0, 0.0, 0.0]])[:, None]
    result = seen(MaskContrast(leak=0.1), told)[0]
    torch.testing.assert_close(result, torch.tensor([0.1 + 0.1, 0.55 + 0.1, 1.0 + 0.1]))
