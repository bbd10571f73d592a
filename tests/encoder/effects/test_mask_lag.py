"""A slot trails behind the one before, the first behind the last."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import MaskLag
from tests.encoder.effects.conftest import seen

TOLD = torch.tensor([0.0, 0.125, 0.25, 0.5])


def shown(effect) -> list[float]:
    """What every slot of one pixel shows: slot by slot, with light in that slot only."""
    pattern = TOLD[:, None, None].expand(4, 2, 2)
    return [float(seen(effect, pattern, light[:, None, None].expand(4, 2, 2))[0, 0]) for light in torch.eye(4)]


def test_recursion_starts_from_the_last_pattern() -> None:
    before, expected = 0.5, []
    for told in (0.0, 0.125, 0.25, 0.5):
        before = 0.7 * told + 0.3 * before
        expected.append(before)
    assert shown(MaskLag(lag=0.3)) == pytest.approx(expected)
