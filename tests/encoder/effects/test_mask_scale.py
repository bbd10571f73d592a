"""The mask's image grows about the middle, its brightness stays."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import MaskScale
from tests.encoder.effects.conftest import seen


def test_formula() -> None:
    pattern = torch.zeros(2, 5, 5)
    pattern[0, 2, 2:4] = 1
    result = seen(MaskScale(scale=2.0), pattern)  # mirrors of 2 x 2 pixels, the middle one from 1.5 to 3.5
    torch.testing.assert_close(result[2], torch.tensor([0.0, 0.5, 1.0, 1.0, 1.0]))
    torch.testing.assert_close(result[:, 2], torch.tensor([0.0, 0.5, 1.0, 0.5, 0.0]))
