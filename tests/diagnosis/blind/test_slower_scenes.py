"""Of a mixture of slots only that counts which no motion does."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sci_lightning.diagnosis.blind.undetermined import slower_scenes
from sci_lightning.encoder.effects import Effect, MaskLag, SyncOffset


@pytest.mark.parametrize("effect", [SyncOffset(offset=0.3), SyncOffset(offset=-0.3), MaskLag(lag=0.3)])
def test_a_scene_that_moves_less(effect: Effect) -> None:
    """Every pattern sees a mean of frames; the last pattern does not see the first frame, nor the first the last."""
    circle, slower = (one.schedule(8) for one in (effect, slower_scenes(type(effect))(**effect.values)))
    assert max(float(circle[0, -1]), float(circle[-1, 0])) > 0.25
    assert float(slower[0, -1]) == float(slower[-1, 0]) == 0
    assert torch.allclose(slower.sum(0), torch.ones(8))
    np.testing.assert_allclose(slower[2:6, 2:6], circle[2:6, 2:6], atol=0.03)


def test_two_slots_have_no_circle() -> None:
    offset = SyncOffset(offset=0.3)
    assert torch.allclose(offset.schedule(2), slower_scenes(SyncOffset)(offset=0.3).schedule(2))
