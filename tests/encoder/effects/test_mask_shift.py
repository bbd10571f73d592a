"""The mask's image moves: +x right, +y down, by exact overlap of squares."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import MaskShift
from tests.encoder.effects.conftest import seen


def dot(row: int, column: int, size: int = 9) -> torch.Tensor:
    """One open mirror, in one of two slots."""
    pattern = torch.zeros(2, size, size)
    pattern[0, row, column] = 1
    return pattern


def test_signs_and_fractions() -> None:
    result = seen(MaskShift(dx=2.0, dy=1.0), dot(4, 3))
    assert result.nonzero().tolist() == [[5, 5]] and result[5, 5] == 1
    result = seen(MaskShift(dx=0.25, dy=-0.5), dot(4, 3))
    torch.testing.assert_close(result[3:5, 3:5], torch.tensor([[0.375, 0.125], [0.375, 0.125]]))
    assert result.sum() == 1


def test_dark_comes_in_from_outside() -> None:
    result = seen(MaskShift(dx=1.5), torch.ones(2, 3, 4) / 2)
    torch.testing.assert_close(result, torch.tensor([0.0, 0.5, 1.0, 1.0]).expand(3, 4))
