"""A part of every slot shows the pattern before (late) or the next (early), cyclically."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import SyncOffset
from tests.encoder.effects.conftest import seen

TOLD = torch.tensor([0.0, 0.125, 0.25, 0.5])


def shown(effect) -> list[float]:
    """What every slot of one pixel shows: slot by slot, with light in that slot only."""
    pattern = TOLD[:, None, None].expand(4, 2, 2)
    return [float(seen(effect, pattern, light[:, None, None].expand(4, 2, 2))[0, 0]) for light in torch.eye(4)]


def test_late_and_early() -> None:
    late = [0.75 * 0 + 0.25 * 0.5, 0.75 * 0.125, 0.75 * 0.25 + 0.25 * 0.125, 0.75 * 0.5 + 0.25 * 0.25]
    assert shown(SyncOffset(offset=0.25)) == pytest.approx(late)
    early = [0.25 * 0.125, 0.75 * 0.125 + 0.25 * 0.25, 0.75 * 0.25 + 0.25 * 0.5, 0.75 * 0.5]
    assert shown(SyncOffset(offset=-0.25)) == pytest.approx(early)
