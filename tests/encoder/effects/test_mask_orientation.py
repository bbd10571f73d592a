"""The patterns mirrored or turned, quarter turns counter-clockwise as NumPy's."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskOrientation
from sci_lightning.errors import BadInput
from tests.encoder.effects.conftest import seen

MASK = torch.tensor([[1.0, 2.0], [3.0, 4.0]]) / 8


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        ("flip_lr", [[2, 1], [4, 3]]),
        ("flip_ud", [[3, 4], [1, 2]]),
        ("rot90", [[2, 4], [1, 3]]),
        ("rot180", [[4, 3], [2, 1]]),
        ("rot270", [[3, 1], [4, 2]]),
        ("transpose", [[1, 3], [2, 4]]),
        ("antitranspose", [[4, 2], [3, 1]]),
    ],
)
def test_formula(operation: str, expected: list[list[float]]) -> None:
    assert (seen(MaskOrientation(operation=operation), MASK.expand(2, 2, 2)) * 4).tolist() == expected


def test_turning_needs_a_square() -> None:
    assert seen(MaskOrientation(operation="rot180"), torch.zeros(2, 2, 3)).shape == (2, 3)
    with pytest.raises(BadInput, match="square"):
        seen(MaskOrientation(operation="rot90"), torch.zeros(2, 2, 3))
    assert len(MaskOrientation.starts(8, (4, 5), 8)) == 3
