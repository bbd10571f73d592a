"""Slot t shows the pattern told for slot t - offset."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import PatternOrder
from tests.encoder.effects.conftest import seen

TOLD = torch.tensor([0.0, 0.125, 0.25, 0.5])


def shown(effect) -> list[float]:
    """What every slot of one pixel shows: slot by slot, with light in that slot only."""
    pattern = TOLD[:, None, None].expand(4, 2, 2)
    return [float(seen(effect, pattern, light[:, None, None].expand(4, 2, 2))[0, 0]) for light in torch.eye(4)]


def test_formula() -> None:
    assert shown(PatternOrder(offset=1)) == [0.5, 0.0, 0.125, 0.25]
    assert shown(PatternOrder(offset=-1)) == [0.125, 0.25, 0.5, 0.0]
    assert shown(PatternOrder(offset=5)) == shown(PatternOrder(offset=1))
