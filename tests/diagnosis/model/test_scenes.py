"""The scenes behind an effect of the laboratory."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.model.scenes import changed_scenes
from sci_lightning.diagnosis.target_effects.scene_shift import SceneShift


def test_no_target_shows_negative_light() -> None:
    """A spline swings below 0 beside an edge."""
    edge = torch.zeros(1, 8, 16)
    edge[..., 8:] = 1.0
    shift = SceneShift(dx=0.5, dy=0.0)
    assert shift.change(edge).min() < -0.01
    (shown,) = changed_scenes(shift, [edge])
    assert shown.min() == 0 and shown.max() > 0.9
